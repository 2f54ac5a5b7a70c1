"""Measures how the speed of the kernel, and of whole campaigns, grows on 1, 2, 4 .. cores or GPUs.

The work per core or GPU is constant. The blocks of the kernel are prepared before the time is
measured. Further losses of campaigns are due to the code around the kernel.
"""

import functools
import os
from typing import Any, NamedTuple

import joblib

from bench import machine, workload
from bench.workload import Workload
from ravenjax.campaign import compile_cache, runner
from ravenjax.engines import selection
from ravenjax.engines.interface import Engine
from ravenjax.numbers.setup import CAMPAIGN


class Work(NamedTuple):
    """The work of each core or GPU."""

    lanes: int = 256  # runs of the bare kernel
    kernel_ticks: int = 10_000  # ticks of a run of the bare kernel
    runs: int = 8192  # runs of a campaign
    ticks: int = 3000  # ticks of a campaign's run


GPU_WORK = Work(405_504, 10_000, 2**18, 10_000)
"""Work of a GPU. The lanes fill an H200 eight times."""


def count_up(total: int) -> list[int]:
    """Return 1, 2, 4 .. and `total`."""
    return sorted({2**k for k in range(total.bit_length())} | {total})


def measure_cores(seconds: float, work: Work | None = None) -> list[dict[str, Any]]:
    """Measure each number of cores, for about `seconds` in total."""
    order = machine.order_cpus(os.sched_getaffinity(0))
    real = sum(not shared for _, shared in order)
    usable = min(joblib.cpu_count(), len(order))
    numbers = [n for n in count_up(real) if n < usable] + [usable]
    engine = selection.select_engine("simd", CAMPAIGN, compile_cache.object_cache())
    rows = []
    for number in numbers:
        os.sched_setaffinity(0, {cpu for cpu, _ in order[:number]})
        row = _measure(engine, number, number, work or Work(), seconds / len(numbers))
        rows.append({"cores": number, "with_hyper_threads": number > real} | row)
    return rows


def measure_gpus(
    seconds: float, number: int, engine: str = "cuda", work: Work = GPU_WORK
) -> list[dict[str, Any]]:
    """Measure all GPUs that this process sees, `number` of them."""
    selected = selection.select_engine(engine, CAMPAIGN, compile_cache.object_cache())
    # While one block runs, the next one is packed.
    return [{"gpus": number} | _measure(selected, number, 2 * number, work, seconds)]


def _measure(
    engine: Engine, number: int, blocks: int, work: Work, seconds: float
) -> dict[str, Any]:
    """Return full ticks per second of `blocks` blocks of the bare kernel, and of a campaign."""
    load = Workload(work.kernel_ticks)
    kernel = engine.compile(load.plan.program, work.lanes * number)
    lanes = min(kernel.size(work.lanes * number // blocks), kernel.lanes)
    ready = load.blocks(kernel, lanes * blocks, lanes)
    run_kernel = functools.partial(load.run, kernel, ready, min(engine.threads, blocks))
    runs = work.runs * number
    config = workload.campaign(runs, work.ticks)
    run_campaign = functools.partial(runner.run_campaign, config, None, engine.name)
    run_kernel()
    run_campaign()
    kernel_s, campaign_s = (workload.repeat(w, 0.4 * seconds) for w in (run_kernel, run_campaign))
    return {
        "kernel_ticks_per_s": lanes * blocks * work.kernel_ticks / min(kernel_s),
        "campaign_ticks_per_s": runs * work.ticks / min(campaign_s),
        "kernel_s": kernel_s,
        "campaign_s": campaign_s,
        "runs": runs,
    }
