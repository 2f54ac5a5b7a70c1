"""Whole campaigns kept in memory: what one costs before its first run, and what each further run
adds.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence

from ravenjax.bench import clock, workload
from ravenjax.campaign import runner

SIZES = {"cuda": (4096, 65_536, 1_048_576), "simd": (256, 4096, 16_384)}
"""Engine -> runs of a campaign."""
TICKS = {"cuda": 10_000, "simd": 1000}


@dataclasses.dataclass(frozen=True)
class Campaigns:
    """Seconds of whole campaigns: planning, running, tables; tracing and compiling once, in the
    first alone.
    """

    engine: str
    ticks: int  # of a run
    # s of the first in its process, of the smallest size: tracing and compiling, nothing cached
    first_s: float
    seconds: Mapping[int, float]  # runs -> s, the best of some

    @property
    def growth(self) -> tuple[float, float]:
        """(s, s a run) of the line through the smallest and the largest; no growth of one size."""
        less, more = min(self.seconds), max(self.seconds)
        marginal = (self.seconds[more] - self.seconds[less]) / (more - less) if more > less else 0.0
        return self.seconds[more] - marginal * more, marginal


def measure(
    seconds: float,
    engine: str = "auto",
    sizes: Sequence[int] | None = None,
    ticks: int | None = None,
) -> Campaigns:
    """Measure for about so long beyond tracing; the smallest size always, a larger one if it
    promises to fit.
    """
    from ravenjax.engines import selection
    from ravenjax.numbers.setup import CAMPAIGN

    name = selection.fastest(CAMPAIGN)[0] if engine == "auto" else engine
    sizes, length = sizes or SIZES[name], ticks or TICKS[name]
    first = clock.seconds(lambda: _campaign(sizes[0], length, name))
    end, spent = time.perf_counter() + seconds, dict[int, float]()
    for number, runs in enumerate(sizes):
        promise = spent[sizes[number - 1]] * runs / sizes[number - 1] if number else 0.0
        if number and time.perf_counter() + promise > end:
            break
        spent[runs] = min(
            clock.seconds(lambda runs=runs: _campaign(runs, length, name)) for _ in range(2)
        )
    return Campaigns(name, length, first, spent)


def _campaign(runs: int, ticks: int, engine: str) -> None:
    runner.run_campaign(workload.campaign(runs, ticks), None, engine)
