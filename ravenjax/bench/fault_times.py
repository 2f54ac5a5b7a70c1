"""What a run costs by its length after the fault: planning and tables aside, its golden run
included.

Up to its fault a run is its golden run. An engine that goes on from there computes only what comes
after, and with `observe_ms` only so much of that.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from ravenjax.bench import clock, scaling
from ravenjax.bench.clock import Repeats
from ravenjax.campaign import compile_cache, loading, plan
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress.counts import Progress
from ravenjax.engines import selection
from ravenjax.numbers.setup import CAMPAIGN

TICKS, OBSERVE_MS, FAULT_MS = 10_000, 1000, 10
"""Of a run; how long a run is observed after its fault in the second column; how long that
lasts.
"""
SHARES = (0.0, 0.25, 0.5, 0.75, 0.9)
"""Of the run that are over when the fault strikes. At the first there is nothing to go on from."""
LEAST_RUNS, MOST_RUNS = {"cuda": 101_376}, 2**18
"""At each time: fewer do not fill a GPU twice; more make it no faster, and take long to plan."""
_LEAST_RUNS = 256  # of other engines


@dataclasses.dataclass(frozen=True)
class FaultTime:
    """Runs whose fault strikes at one time."""

    start_ms: int
    observe_ms: int | None  # None: to the end of the run
    after_ms: int  # from the fault to the last tick that counts
    run_s: Repeats  # s a run, all cores or devices together


@dataclasses.dataclass(frozen=True)
class FaultTimes:
    """Cost of runs by when their fault strikes."""

    engine: str
    ticks: int
    runs: int  # at each time
    times: tuple[FaultTime, ...]

    @property
    def whole_s(self) -> float:
        """s of a run whose fault strikes at its very beginning and that is observed to its end."""
        return next(
            one.run_s.smallest for one in self.times if one.start_ms == 0 and one.observe_ms is None
        )

    @property
    def line(self) -> tuple[float, float]:
        """(s a run, s a run and second after the fault): the line through all that are observed
        to their end.
        """
        some = [one for one in self.times if one.observe_ms is None]
        x, y = [one.after_ms / 1e3 for one in some], [one.run_s.smallest for one in some]
        slope, base = np.polyfit(x, y, 1)
        return float(base), float(slope)


def campaign(runs: int, start_ms: int, observe_ms: int | None, ticks: int) -> CampaignConfig:
    """Suturing with the gold arm, a DAC command overwritten at one time."""
    fault = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow", "insertion"],
        "effect": "overwrite",
        "value": {"uniform": [-20_000, 20_000]},
        "start_ms": start_ms,
        "duration_ms": FAULT_MS,
    }
    observed = {} if observe_ms is None else {"observe_ms": observe_ms}
    return loading.from_dict(
        {
            "campaign": {
                "name": "bench",
                "seed": 1,
                "duration_s": ticks / 1000,
                "arms": ["gold"],
                **observed,
            },
            "operator": {"motion": "suture", "seed": 1},
            "group": [{"name": "dac", "design": "random", "runs": runs, "fault": [fault]}],
        }
    )


def measure(
    seconds: float,
    engine: str = "auto",
    ticks: int = TICKS,
    observe_ms: int = OBSERVE_MS,
    shares: Sequence[float] = SHARES,
    least_runs: int | None = None,
) -> FaultTimes:
    """Measure for about so long beyond tracing, each time in turn and again. least_runs: None:
    as the engine needs.
    """
    starts = [round(share * ticks) for share in shares]
    ways = [(start, way) for way in (None, observe_ms) for start in starts]
    backend = selection.select(engine, CAMPAIGN, compile_cache.objects())
    least = least_runs or LEAST_RUNS.get(backend.name, _LEAST_RUNS)

    def computation(runs: int, start: int, way: int | None) -> Computation:
        ready = plan.make_plan(campaign(runs, start, way, ticks))
        return Computation(ready, backend, Progress("", runs, runs, ticks, None))

    def rate(runs: int) -> float:
        some = computation(runs, 0, None)
        some.compile()
        _run(some)  # prepares what only comes with the runs
        return runs * ticks / clock.seconds(functools.partial(_run, some))

    runs = scaling.affordable(rate, ticks, least, 0.5 * seconds / len(ways), MOST_RUNS)
    kernels = {way: computation(runs, starts[0], way) for way in (None, observe_ms)}
    for kernel in kernels.values():
        kernel.compile()
    plans = {(start, way): plan.make_plan(campaign(runs, start, way, ticks)) for start, way in ways}
    work = {(start, way): kernels[way].of(ready) for (start, way), ready in plans.items()}
    spent = {way: list[float]() for way in ways}
    for one in work.values():
        _run(one)

    def once() -> None:
        for way in ways:
            spent[way].append(clock.seconds(functools.partial(_run, work[way])) / runs)

    scaling.rounds(once, 0.6 * seconds)
    times = [
        FaultTime(start, way, after_ms(plans[start, way]), Repeats(tuple(spent[start, way])))
        for start, way in ways
    ]
    return FaultTimes(backend.name, ticks, runs, tuple(times))


def after_ms(ready: Plan) -> int:
    """Mean ticks of a plan's runs from the first in which its fault may act to the last that
    counts.
    """
    return round(float((ready.ends - np.minimum(ready.acts, ready.ends)).mean()))


def _run(computation: Computation) -> None:
    for _ in computation.blocks([range(computation.plan.runs)]):
        pass
