"""What the coordinator of worker processes costs: its own time a chunk, beside the time that chunks
take to compute.

    python analysis/scale/coordinator.py [--workers N] [--case CHUNKS ROWS SECONDS]

Runs campaigns of 10 000 tiny chunks, of chunks of the smallest and of the largest default size
through executor `processes` into a temporary folder. Counted is the CPU time of this process, which
hands out, receives, writes, records and shows progress, and that of the workers, without their
start; waiting counts for nothing, so a busy machine hardly disturbs it. A campaign of 10 000 chunks
has the largest ones unless its file says otherwise.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import ravenjax as rj
from ravenjax.campaign import runner
from ravenjax.campaign.executors.carriers.processes import Processes
from ravenjax.store import parts

COLUMNS = (
    "chunks",
    "rows a chunk",
    "run s",
    "wall s",
    "workers' CPU s",
    "coordinator's CPU s",
    "ms a chunk",
    "share %",
)


CASES = ((10_000, 8, 0.05), (200, parts.FEWEST_ROWS, 0.5), (8, parts.MOST_ROWS, 0.5))
"""Chunks, rows of each, length of a run (s)."""


class Measured(NamedTuple):
    """One campaign."""

    chunks: int
    rows: int  # of a chunk
    duration_s: float  # of a run
    wall_s: float  # from the first worker that is ready to the end
    workers_s: float  # CPU of all workers, without what they take to start
    coordinator_s: float  # CPU of this process over the same time

    @property
    def a_chunk_s(self) -> float:
        """CPU of the coordinator for a chunk."""
        return self.coordinator_s / self.chunks

    def cells(self) -> tuple[str, ...]:
        """A row of the table."""
        share = 100.0 * self.coordinator_s / self.workers_s
        numbers = (f"{self.wall_s:.1f}", f"{self.workers_s:.1f}", f"{self.coordinator_s:.2f}")
        return (
            str(self.chunks),
            str(self.rows),
            f"{self.duration_s:g}",
            *numbers,
            f"{1e3 * self.a_chunk_s:.2f}",
            f"{share:.2f}",
        )


def campaign(runs: int, rows: int, duration_s: float) -> rj.api.CampaignConfig:
    """Random faults behind the checks, like those of quick.toml."""
    fault = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow", "insertion"],
        "effect": ["overwrite", "latch_offset"],
        "value": {"uniform": [-20000, 20000]},
        "start_ms": {"uniform": [1, 1000 * duration_s - 5]},
        "duration_ms": [1, 4, 16, 64],
    }
    return rj.load_campaign(
        {
            "campaign": {"name": "coordinator", "duration_s": duration_s, "chunk": rows},
            "operator": {"motion": "suture"},
            "group": [{"name": "dac", "design": "random", "runs": runs, "fault": [fault]}],
        }
    )


def measure(chunks: int, rows: int, duration_s: float, workers: int) -> Measured:
    """One campaign of so many chunks. CPU of workers is read from the kernel, while they run and
    once they ended.
    """
    began: list[tuple[float, float, float]] = []

    def told(status) -> None:
        if status.phase == "run" and not began:
            began.append((time.perf_counter(), time.process_time(), _workers_cpu()))

    with tempfile.TemporaryDirectory() as folder:
        config, executor = campaign(chunks * rows, rows, duration_s), Processes(workers)
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        runner.run_campaign(config, Path(folder), "simd", executor=executor, on_progress=told)
        now = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall, cpu, starting = began[0]
    total = now.ru_utime + now.ru_stime - ended.ru_utime - ended.ru_stime
    # A worker that is ready later than the first still starts when the clock does: as much as the
    # first took, each.
    return Measured(
        chunks,
        rows,
        duration_s,
        time.perf_counter() - wall,
        max(1e-9, total - starting),
        time.process_time() - cpu,
    )


def _workers_cpu() -> float:
    """CPU time of this process's children up to now, s."""
    ticks, found = os.sysconf("SC_CLK_TCK"), 0.0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == os.getpid():
            found += (int(fields[11]) + int(fields[12])) / ticks
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--case",
        nargs=3,
        type=float,
        metavar=("CHUNKS", "ROWS", "SECONDS"),
        help="only this campaign",
    )
    given = parser.parse_args()
    cases = (
        CASES if given.case is None else ((int(given.case[0]), int(given.case[1]), given.case[2]),)
    )
    print("| " + " | ".join(COLUMNS) + " |\n|" + "--:|" * len(COLUMNS))
    for chunks, rows, duration_s in cases:
        print(
            "| " + " | ".join(measure(chunks, rows, duration_s, given.workers).cells()) + " |",
            flush=True,
        )


if __name__ == "__main__":
    main()
