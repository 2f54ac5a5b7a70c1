"""Measures whether the memory of a campaign of many short runs grows while it runs.

    python analysis/scale/memory.py [--runs 1000000] [--duration 0.5] [--workers N]

Prints resident memory of this process (and of all workers, if there are any), read from the kernel,
at 0, 10, 50 and 100 % of the runs. It also prints the memory of the plan, the only part that grows
with the number of runs.
"""

import argparse
import os
import tempfile
from pathlib import Path

import coordinator

from ravenjax.campaign import plan, runner
from ravenjax.campaign.executors import choose_executor
from ravenjax.store import parts

MARKS = (0.0, 0.1, 0.5, 1.0)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--duration", type=float, default=0.5)
    parser.add_argument("--workers", type=int, default=None)
    given = parser.parse_args()
    config = coordinator.campaign(given.runs, parts.rows_of_a_part(given.runs), given.duration)
    before = _resident(os.getpid())
    ready = plan.make_plan(config)
    planned = _resident(os.getpid()) - before
    del ready
    print(
        f"{given.runs} runs of {given.duration} s; the plan of them takes about {planned:.0f} MiB"
    )
    print("| done | this process, MiB | workers, MiB | runs/s |\n|--:|--:|--:|--:|")
    marks = list(MARKS)

    def told(status) -> None:
        while marks and status.phase in ("run", "done") and status.done >= marks[0] * status.total:
            marks.pop(0)
            mine, theirs = _resident(os.getpid()), sum(map(_resident, _children()))
            rate = f"{status.runs_per_s:.0f}" if status.runs_per_s is not None else ""
            print(f"| {status.done} | {mine:.0f} | {theirs:.0f} | {rate} |", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        executor = choose_executor(None, given.workers)
        runner.run_campaign(config, Path(folder), "simd", executor=executor, on_progress=told)


def _resident(process: int) -> float:
    """Return resident memory, MiB; 0 for a process that has ended."""
    try:
        text = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    return next(
        (int(line.split()[1]) / 1024 for line in text.splitlines() if line.startswith("VmRSS")), 0.0
    )


def _children() -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(path.read_text().rpartition(")")[2].split()[1]) == os.getpid():
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


if __name__ == "__main__":
    main()
