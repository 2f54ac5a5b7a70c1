"""Starts a campaign again and again and kills each start at a random moment: a process of its own.

    python killing_driver.py FILE OUT SEED KILLS

Starts are forked from this process, which has imported everything and computed nothing, so that a
start costs only what it does itself. A third of the moments is drawn by the clock, the others a
random number of parts after its runs begin, so that a busy machine does not shift them all to the
beginning; the last line printed tells how many parts each start left behind.
"""

import json
import os
import random
import signal
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

from ravenjax.cli import main

STARTS_S, PARTS, THEN_S = 2.0, 8, 0.05
"""How late, at most, a start is killed: after its beginning, or after so many parts and then
some time.
"""


def start(file: str, out: Path) -> int:
    """Process id of a new start."""
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os._exit(main(["run", file, "--out", str(out), "--engine", "simd", "--no-report"]))
    return child


def until(condition: Callable[[], bool], child: int) -> None:
    """Wait for a condition while a start lives."""
    while (
        os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None and not condition()
    ):
        time.sleep(0.005)


def runs(out: Path, child: int) -> bool:
    """Whether the progress file says that this start runs."""
    try:
        told = json.loads((out / "progress.json").read_text())
    except (OSError, ValueError):
        return False
    return told["pid"] == child and told["phase"] == "run"


def parts(out: Path) -> int:
    """Parts that are there."""
    return len(list(out.glob("parts/part-*.parquet")))


def killed_at_random(file: str, out: Path, seed: int, kills: int) -> list[int]:
    """Parts on disk after each kill. Raises where a start ended by itself."""
    chance, left = random.Random(seed), []
    for number in range(kills):
        child = start(file, out)
        if chance.random() < 1 / 3:
            time.sleep(chance.uniform(0.0, STARTS_S))
        else:
            until(lambda child=child: runs(out, child), child)
            wanted = parts(out) + chance.randrange(PARTS)
            until(lambda wanted=wanted: parts(out) >= wanted, child)
            time.sleep(chance.uniform(0.0, THEN_S))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            raise SystemExit(
                f"start {number} ended by itself, code {os.waitstatus_to_exitcode(status)}, after"
                f" {left}"
            )
        left.append(parts(out))
    return left


if __name__ == "__main__":
    warnings.simplefilter("ignore", RuntimeWarning)
    print(
        json.dumps(
            killed_at_random(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
        )
    )
