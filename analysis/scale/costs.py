"""Measures the time of each step of a campaign other than the simulation, and writes costs.json in
the folder of this file.

    python analysis/scale/costs.py [FOLDER]

FOLDER is on the disk whose writes are measured; by default a temporary folder of this machine. For
steps that compute, the CPU time of this process is measured, so that other processes hardly affect
it. For steps that wait for a disk, the elapsed time is measured. Each number is the smallest of
several repeats. The campaign is one group of Sobol draws with one fault per run. The time of a Ray
task is that of an empty task with one local worker, in the process that starts the task.
"""

import hashlib
import json
import logging
import pickle
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ravenjax.campaign import compile_cache, loading, plan, runner
from ravenjax.campaign.executors import ray_cluster
from ravenjax.campaign.executors.protocol import Pack, Work, finish_chunk
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines import selection
from ravenjax.store import manifest, parts
from ravenjax.store.folder import ResultFolder

CHUNKS = (64, 256, 1024, 4096, 16_384, 65_536, 202_752)
PLANNED = 1_000_000
TICKS = 500
REPEATS = 3


def campaign(runs: int) -> Plan:
    """Return the plan of `runs` runs."""
    fault = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow", "insertion"],
        "effect": ["overwrite", "latch_offset"],
        "value": {"uniform": [-20_000, 20_000]},
        "start_ms": {"uniform": [100, 400]},
        "duration_ms": [1, 2, 4, 8, 16, 32, 64, 128],
    }
    group = {"name": "unchecked command", "design": "sobol", "runs": runs, "fault": [fault]}
    raw = {"campaign": {"name": "costs", "duration_s": TICKS / 1e3}, "group": [group]}
    return plan.make_plan(loading.from_dict(raw))


def least(
    work: Callable[[], Any], clock: Callable[[], float] = time.process_time, repeats: int = REPEATS
) -> float:
    """Return the seconds of the quickest of several calls."""
    found = []
    for _ in range(repeats):
        start = clock()
        work()
        found.append(clock() - start)
    return min(found)


def bytes_of(ready: Plan) -> int:
    """Return the bytes that a plan holds for its runs."""
    arrays = [*ready.faults.values(), *ready.varied.values(), ready.golden]
    return sum(array.nbytes for array in arrays) + int(ready.rows.memory_usage(deep=True).sum())


def main(folder: Path) -> dict[str, Any]:
    """Return all costs: in s, and in B if the name says bytes."""
    compile_cache.enable_cache()
    plan_s = least(lambda: campaign(PLANNED), repeats=2)
    ready = campaign(CHUNKS[-1])
    engine = selection.select_engine(
        "simd", ready.program.setup.precision, compile_cache.object_cache()
    )
    record = runner.make_manifest(ready, engine)
    pack = partial(parts.encode_part, shape=record.shape, config_hash=record.config_hash)
    work = Work(ready, engine, pack, lambda finished: None, Progress("", 0, 0, 1, None))
    head = ray_cluster.make_head(work, [range(CHUNKS[-1])], 1)
    start = time.perf_counter()
    worker = ray_cluster.Worker(head)
    worker.compute(ready.row_fields(slice(CHUNKS[0])))
    ready_s = time.perf_counter() - start
    rows = [
        chunk_costs(worker, pack, ready, chunk, folder / str(chunk), record) for chunk in CHUNKS
    ]
    return {
        "machine": f"{platform.processor() or platform.machine()}, {engine.device}",
        "plan_s_per_million": plan_s * 1e6 / PLANNED,
        "plan_bytes_per_run": bytes_of(campaign(PLANNED)) / PLANNED,
        "ready_s": ready_s,
        "head_bytes": len(pickle.dumps(head)),
        "chunks": rows,
        "folder": folder_costs(folder / "many", record),
        "sha256_s_per_byte": least(lambda: hashlib.sha256(b"\0" * 2**26).digest()) / 2**26,
        "ray_task_s": ray_task(),
    }


def ray_task(tasks: int = 300) -> float:
    """Return CPU seconds of this process for each empty Ray task with a small argument."""
    import ray

    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
    nothing = ray.remote(lambda given: given)

    def some() -> None:
        under_way = [nothing.remote(ray.put(b"x" * 1000)) for _ in range(tasks)]
        while under_way:
            done, under_way = ray.wait(under_way, num_returns=1)
            ray.get(done)

    try:
        some()
        return least(some) / tasks
    finally:
        ray.shutdown()


def chunk_costs(
    worker: ray_cluster.Worker,
    pack: Pack,
    ready: Plan,
    chunk: int,
    folder: Path,
    record: manifest.Manifest,
) -> dict[str, Any]:
    """Return the cost of one chunk of `chunk` rows at each step."""
    share = ready.row_fields(slice(chunk))
    sent = pickle.dumps(share, protocol=5)
    repeats = REPEATS if chunk > 1024 else 5 * REPEATS
    computed = worker.compute(share)
    finished = finish_chunk(*computed, pack)
    back = pickle.dumps(finished, protocol=5)
    store = ResultFolder.open(folder, record)
    part = finished.packed.part
    return {
        "rows": chunk,
        "share_s": least(
            lambda: pickle.dumps(ready.row_fields(slice(chunk)), protocol=5), repeats=repeats
        ),
        "share_bytes": len(sent),
        "compute_s_per_tick": least(lambda: worker.compute(share), repeats=2) / (chunk * TICKS),
        "table_s": least(lambda: finish_chunk(*computed, pack), repeats=repeats),
        "receive_s": least(lambda: pickle.loads(back), repeats=repeats),
        "part_bytes": part.size,
        "put_s": least(
            lambda: parts.put_part(folder / "parts", finished.packed),
            time.perf_counter,
            3 * repeats,
        ),
        "put_cpu_s": least(
            lambda: parts.put_part(folder / "parts", finished.packed), repeats=3 * repeats
        ),
        "record_s": least(
            lambda: manifest.record_part(store.path, part), time.perf_counter, 3 * repeats
        ),
    }


def folder_costs(folder: Path, record: manifest.Manifest, count: int = 2000) -> dict[str, float]:
    """Return the cost of a folder's record for each of its parts."""
    (folder / "parts").mkdir(parents=True)
    listed = [
        parts.Part(file=f"part-{i:09d}-{i:09d}.parquet", first=i, last=i, sha256="0" * 64, size=1)
        for i in range(count)
    ]
    whole = record.model_copy(update={"parts": tuple(listed), "runs": count})
    write = least(lambda: manifest.write_manifest(folder, whole), time.perf_counter)
    read = least(lambda: manifest.read_manifest(folder))
    return {"parts": count, "write_s_per_part": write / count, "read_s_per_part": read / count}


if __name__ == "__main__":
    given = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
    place = given / "ravenjax-costs"
    try:
        found = main(place)
    finally:
        shutil.rmtree(place, ignore_errors=True)
    text = json.dumps(found, indent=1) + "\n"
    (Path(__file__).parent / "costs.json").write_text(text)
    print(text)
