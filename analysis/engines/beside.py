"""Compares two commits. Their checkouts run in turn, so that load and clock rates affect both
alike.

    git worktree add ../other COMMIT
    python analysis/engines/beside.py ../other [SECONDS]

Both run with the Python and the packages of this environment.
"""

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1]))

import joblib

from bench import commands, machine, process, suite, workload
from ravenjax.campaign import compile_cache

BESIDE_RUNS, BESIDE_TICKS = 4096, 3000
"""Runs and ticks of the campaign that is run twice in a process. The second run is measured."""
_RUN_TWICE = """
import json, os, sys, time
cpus, campaign = json.loads(sys.argv[1])
os.sched_setaffinity(0, cpus)
import ravenjax
campaign = ravenjax.load_campaign(campaign)
ravenjax.run(campaign)
begin = time.perf_counter()
ravenjax.run(campaign)
print(json.dumps([time.perf_counter() - begin, os.path.realpath(ravenjax.__file__)]))
"""


def compare(there: Path, seconds: float, here: Path = process.ROOT) -> list[dict[str, Any]]:
    """Measure commands and campaigns in turn, in `here` and in the checkout `there`, for about
    `seconds`.

    Uses only features that every commit has. Raises RuntimeError for a command that fails.
    """
    times: dict[str, dict[str, list[float]]] = {}
    sides = [("here", here), ("there", there)]

    def run_both() -> None:
        for side, root in sides:
            print(f"measuring {root}", file=sys.stderr)
            with tempfile.TemporaryDirectory() as folder:
                for what, spent in _measure_once(root, Path(folder)).items():
                    times.setdefault(what, {}).setdefault(side, []).append(spent)
        sides.reverse()

    workload.repeat(run_both, seconds)
    return [
        {"what": what, "ratio_of_best": min(both["here"]) / min(both["there"]), **both}
        for what, both in times.items()
    ]


def _measure_once(root: Path, folder: Path) -> dict[str, float]:
    """Return the seconds of each measured item for one checkout."""
    times = {
        f"ravenjax {what}": commands.run_command(folder, *tokens, root=root).seconds
        for what, tokens in commands.list_commands(folder).items()
    }
    order = [cpu for cpu, _ in machine.order_cpus(os.sched_getaffinity(0))]
    for count in sorted({1, joblib.cpu_count()}):
        keys = workload.campaign_keys(BESIDE_RUNS, BESIDE_TICKS)
        done = process.run_command(
            [sys.executable, "-c", _RUN_TWICE, json.dumps([order[:count], keys])],
            {compile_cache.VARIABLE: str(folder / "cache")},
            folder=folder,
            root=root,
        )
        spent, file = json.loads(done.output.splitlines()[-1])
        if Path(file) != root / "ravenjax/__init__.py":
            raise RuntimeError(f"{file} was measured in place of {root}/ravenjax/__init__.py")
        times[f"campaign of {BESIDE_RUNS} runs of {BESIDE_TICKS} ms, cores: {count}"] = spent
    return times


def main(there: str, seconds: str = "300") -> None:
    """Print the seconds of both."""
    rows = compare(Path(there).resolve(), float(seconds))
    print(
        suite.write_markdown(
            "Two commits", f"beside.py {there}", suite.make_tables({"beside": rows})
        )
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
