"""Counts the runs that return to their golden run: `python analysis/branching/returning.py
[CAMPAIGN [RUNS]]`.

A run returns if, from some tick until its end, every time series equals that of its golden run to
the bit: motors, cables, links, encoders, the software's poses, torques and commands, PLC, brakes,
nominal model and cue. After the return only another fault window could change the run, so the rest
need not be computed. State that no series contains may still differ, so the count is an upper
bound.
"""

import sys

import numpy as np

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.campaign.faults import span
from ravenjax.campaign.plan import Plan
from ravenjax.engines import selection
from ravenjax.engines.interface import Block, Tracer
from ravenjax.stages.recorded import read_series


def series_of(ready: Plan, tracer: Tracer, block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return every number of a run that a trace keeps, as bits [ticks, numbers], and the golden
    run's.
    """
    result, signals = tracer.kernel.run_signals(block, ready.columns)
    kept = read_series(ready.config.robot, ready.program, signals)
    columns = [
        values.reshape(len(values), -1)
        for name, values in kept.items()
        if not name.startswith("fault")
    ]
    numbers = [np.ascontiguousarray(values, np.float32).view(np.uint32) for values in columns]
    return np.concatenate(numbers, axis=1), result.reference


def back_from(run: np.ndarray, golden: np.ndarray) -> int:
    """Return the tick from which a run equals its golden run; the number of ticks if it does not at
    the end.
    """
    apart = np.flatnonzero((run != golden).any(axis=1))
    return 0 if not len(apart) else int(apart[-1]) + 1


def main(campaign: str, runs: int) -> None:
    ready = plan.make_plan(rj.load_campaign(campaign))
    tracer = selection.select_engine("simd", ready.program.setup.precision).tracer(ready.program, 1)
    rng, ticks = np.random.default_rng(0), ready.program.ticks
    rows = np.sort(rng.choice(np.flatnonzero(ready.acts < ticks), runs, replace=False))
    ended = span.observation_ends(ready.faults, ticks, 0, ready.clocks)
    golden: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    back, idle, saved = 0, 0, 0
    for row in rows.tolist():
        number = int(ready.golden[row])
        if number not in golden:
            golden = {
                number: series_of(ready, tracer, Block(*ready.lanes([row], 1, harmless=True), None))
            }
        own, reference = golden[number]
        block = Block(*ready.lanes([row], 1), reference)
        first = back_from(series_of(ready, tracer, block)[0], own)
        idle, back = idle + (first == 0), back + (0 < first < ticks)
        saved += ticks - max(first, int(ended[row]))
    print(
        f"{campaign}: of {runs} runs with a fault {idle} are their golden run throughout, {back}"
        " come back to it."
    )
    print(
        f"The ticks after that and after their fault are {100 * saved / (runs * ticks):.1f} % of"
        " all."
    )


if __name__ == "__main__":
    words = [*sys.argv[1:], *("quick", "600")[len(sys.argv) - 1 :]]
    main(words[0], int(words[1]))
