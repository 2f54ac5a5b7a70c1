"""How many runs a wanted precision needs, and when to stop."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Method, Rate, alpha_of, bounds, rates


def runs_for_half_width(
    half_width: float, confidence: float = 0.95, rate: float = 0.5, population: int | None = None
) -> int:
    """Runs that give a rate an interval of +- half_width (fraction), drawn from `population` possible faults.

    n = N / (1 + e^2 (N - 1) / (t^2 p (1 - p))), Leveugle et al., DATE 2009; without population its limit. rate 0.5 is
    the worst case. It takes every run as an independent draw with one outcome. ValueError where half_width or rate is
    not within 0..1 (exclusive) or the population is empty.
    """
    from statsmodels.stats.proportion import samplesize_confint_proportion

    _fraction(half_width, "half_width")
    _fraction(rate, "rate")
    endless = float(samplesize_confint_proportion(rate, half_width, alpha_of(confidence)))
    if population is None:
        return _up(endless)
    if population < 1:
        raise ValueError(f"a population holds at least one fault, got {population}")
    return _up(population / (1 + (population - 1) / endless))


def runs_to_bound(rate: float, confidence: float = 0.95) -> int:
    """Runs without a single case that show a rate to be at most `rate` (one-sided, exact): about 3/rate at 95 %."""
    _fraction(rate, "rate")
    return _up(math.log(alpha_of(confidence)) / math.log1p(-rate))


class MoreRuns(NamedTuple):
    """Further runs to a wanted half-width: `expected` where the rate stays as seen, `safe` where it moves within its
    interval towards one half, where a rate is hardest to know."""

    expected: int
    safe: int


def more_runs(k: int, n: int, half_width: float, confidence: float = 0.95) -> MoreRuns:
    """Further runs until the Wilson interval of a rate seen as k of n is +- half_width (fraction) or narrower.

    ValueError unless 0 <= k <= n, n > 0 and 0 < half_width < 0.5.
    """
    (seen,) = rates(k, n, confidence)
    if not seen.n:
        raise ValueError("more_runs: no run was seen yet; plan with runs_for_half_width")
    if not 0 < half_width < 0.5:
        raise ValueError(f"more_runs: half_width lies between 0 and 0.5, got {half_width}")
    worst = min(max(0.5, seen.low), seen.high)
    return MoreRuns(*(max(0, _wilson_runs(p, half_width, confidence) - seen.n) for p in (seen.value, worst)))


class Decision(NamedTuple):
    """What a planned look says: stop or go on, why, and every rate with an interval that stays honest."""

    stop: bool
    reached: bool  # every interval is as narrow as asked
    widest: float  # half-width, fraction; 1 where a group has no run yet
    rates: list[Rate]


class StopRule(NamedTuple):
    """Stop at the first planned look at which every interval is as narrow as asked.

    A user who looks at each of m looks and stops when it suits has m chances to be wrong. So the looks are fixed before
    the first run (`looks`, total numbers of runs, increasing), and each look's intervals are made at confidence
    1 - (1 - confidence) / (m * groups): by Bonferroni's inequality all `groups` intervals of all looks hold together
    with the wanted confidence, hence those of the look one stops at, whatever the reason to stop. groups = 1 promises
    it for each rate alone. With the exact method the promise holds for every n; with "wilson" nearly.
    """

    half_width: float
    looks: tuple[int, ...]
    confidence: float = 0.95
    groups: int = 1
    method: Method = "clopper_pearson"

    def look_confidence(self) -> float:
        """Confidence at which each interval of each look is made."""
        return 1 - alpha_of(self.confidence) / (len(self.looks) * self.groups)

    def decide(self, runs: int, k: ArrayLike, n: ArrayLike) -> Decision:
        """Decision at the planned look after `runs` runs, with k[g] cases in n[g] runs of each group.

        ValueError where `runs` is no planned look, the looks do not increase, or half_width is no fraction.
        """
        _fraction(self.half_width, "half_width")
        if not self.looks or list(self.looks) != sorted(set(self.looks)) or self.looks[0] < 1:
            raise ValueError(f"a stop rule needs increasing numbers of runs as its looks, got {self.looks}")
        if runs not in self.looks:
            raise ValueError(
                f"a look after {runs} runs was not planned, only after {self.looks}: it would not be honest"
            )
        found = rates(k, n, self.look_confidence(), self.method)
        half = [(rate.high - rate.low) / 2 if rate.n else 1.0 for rate in found]
        widest = max(half, default=1.0)
        reached = widest <= self.half_width
        return Decision(reached or runs == self.looks[-1], reached, widest, found)


def doubling_looks(first: int, last: int) -> tuple[int, ...]:
    """Looks after first, 2 first, 4 first ... runs and after `last`: few, so that each costs little confidence."""
    if not 1 <= first <= last:
        raise ValueError(f"doubling_looks needs 1 <= first <= last, got {first}, {last}")
    count = math.floor(math.log2(last / first)) + 1
    return tuple(sorted({*(first * 2**i for i in range(count)), last}))


def _wilson_runs(rate: float, half_width: float, confidence: float) -> int:
    """Fewest runs with which a Wilson interval about `rate` is +- half_width or narrower."""
    from scipy.optimize import root_scalar

    def excess(log_n: float) -> float:
        low, high = bounds(np.array(rate * math.exp(log_n)), np.array(math.exp(log_n)), confidence)
        return float(high - low) / 2 - half_width

    most = math.log(runs_for_half_width(half_width, confidence)) + 1
    if excess(0.0) <= 0:
        return 1
    return _up(math.exp(root_scalar(excess, bracket=(0.0, most), xtol=1e-12).root))


def _up(count: float) -> int:
    """Rounded up, but for what only float rounding has lifted above a whole number."""
    return math.ceil(count * (1 - 1e-9))


def _fraction(value: float, name: str) -> None:
    if not 0 < value < 1:
        raise ValueError(f"{name} is a fraction between 0 and 1, got {value}")
