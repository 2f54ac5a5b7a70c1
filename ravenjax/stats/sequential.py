"""Decides when to stop, with intervals that hold for any stopping decision.

A user who looks at m sample sizes and stops at a convenient one has m chances to be wrong. Each
rate of a stratum therefore has a confidence sequence: intervals that hold at all sizes together
(`anytime_bounds`), so that a look costs nothing. Every sequence has confidence 1 - (1 - confidence)
/ (strata x rates). By Bonferroni's inequality, all of them hold together with the wanted
confidence. This includes sizes that depend on the data.

The rate of the whole table is the mean of the strata's rates, weighted by the sizes of the strata.
Its confidence sequence is approximate. It is computed like the sequence of a simple random sample
with the effective number of runs (`stratified_rate`), at confidence 1 - (1 - confidence) / rates.

Runs count as independent draws. A table that is itself the population, such as a shuffled grid, is
drawn without replacement, so its intervals are too wide; `analysis/stopping` simulates this case.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer

from ravenjax import resources
from ravenjax.stats.intervals import (
    Estimate,
    Rate,
    alpha_of,
    anytime_bounds,
    rate_bounds,
    rates_with_intervals,
)

Of = Literal["groups", "whole"]
Allocation = Literal["proportional", "neyman"]


class Stratum(NamedTuple):
    """A subset of the table that is sampled separately, in the order of its draws."""

    name: str
    size: int  # number of draws
    # True if its rates must be precise. Otherwise the whole stratum is computed at the first look.
    judged: bool = True


# A float that is null in JSON if it is NaN. The last digits differ between machines.
_Number = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: None if math.isnan(value) else float(f"{value:.9g}")),
]


class Interval(BaseModel):
    """One rate with its simultaneous interval, as fractions; NaN if no run was valid."""

    model_config = ConfigDict(frozen=True)

    rate: str
    stratum: str  # "" for the whole table
    k: int
    n: int
    value: _Number
    low: _Number
    high: _Number

    @property
    def half_width(self) -> float:
        """The half-width as a fraction; 1 if no run was valid."""
        return (self.high - self.low) / 2 if self.n else 1.0


class Look(BaseModel):
    """The result and the decision of one look."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    number: int  # from 1
    looks: int  # largest number of looks
    taken: dict[str, int]  # number of computed draws of each stratum
    # Number of all draws of each stratum, the weights of a rate over several strata.
    held: dict[str, int]
    intervals: tuple[Interval, ...]
    widest: _Number  # largest half-width of the strata in `waiting`, or of all strata; fraction
    # Strata whose intervals are too wide and that are not completely computed; "": whole table.
    waiting: tuple[str, ...]
    stop: bool  # True if the campaign ends after this look
    half_width: float  # wanted half-width, fraction
    each: _Number  # confidence of each interval
    even: bool  # True if the same share of every stratum was computed


@dataclasses.dataclass(frozen=True)
class Sequential:
    """The stop rule: which rates must be how precise, and at which sizes they are examined."""

    strata: tuple[Stratum, ...]
    rates: tuple[str, ...]
    half_width: float  # fraction
    shares: tuple[float, ...]  # of each stratum, at each look, increasing
    confidence: float = 0.95
    of: Of = "groups"
    allocation: Allocation = "proportional"

    @property
    def size(self) -> np.ndarray:
        """The number of draws of each stratum, int64 [strata]."""
        return np.array([stratum.size for stratum in self.strata], np.int64)

    @property
    def judged(self) -> np.ndarray:
        """Which strata must have precise rates, bool [strata]."""
        return np.array([stratum.judged and stratum.size > 0 for stratum in self.strata])

    @property
    def each(self) -> float:
        """The confidence of each interval: the intervals share the chance to miss (Bonferroni)."""
        populations = int(self.judged.sum()) if self.of == "groups" else 1
        return 1 - alpha_of(self.confidence) / (populations * len(self.rates))

    def sizes(self) -> np.ndarray:
        """Return the planned draws before each look, cumulative, int64 [looks, strata]."""
        # [looks, strata]: share of the look times size of the stratum. The tolerance prevents that
        # rounding adds a draw.
        planned = np.ceil(np.outer(self.shares, self.size) - 1e-9).astype(np.int64)
        planned = np.clip(planned, np.minimum(1, self.size), self.size)
        # Strata that are not judged need no precise rates. They are drawn whole at the first look.
        return np.where(self.judged, planned, self.size)

    def decide(self, number: int, taken: np.ndarray, k: np.ndarray, n: np.ndarray) -> Look:
        """Return the result and the decision of look `number` (from 1), with k[rate, stratum]
        events in n[stratum] valid draws. `taken`: number of computed draws of each stratum, which
        must be planned sizes.
        """
        names = [stratum.name for stratum in self.strata]
        intervals = list(self._intervals(k, n, taken))
        incomplete = taken < self.size
        # The campaign waits for strata with an interval that is too wide, if they have more draws.
        too_wide = [interval for interval in intervals if interval.half_width > self.half_width]
        wide_intervals = [x for x in too_wide if incomplete[self._select(x.stratum)].any()]
        waiting = tuple(dict.fromkeys(interval.stratum for interval in wide_intervals))
        half_widths = [interval.half_width for interval in wide_intervals or intervals]
        return Look(
            number=number,
            looks=len(self.shares),
            taken=dict(zip(names, taken.tolist(), strict=True)),
            held=dict(zip(names, self.size.tolist(), strict=True)),
            intervals=tuple(intervals),
            widest=max(half_widths, default=0.0),
            waiting=waiting,
            stop=not waiting or number == len(self.shares),
            half_width=self.half_width,
            each=self.each,
            # Whether `taken` is a row of the planned sizes [looks, strata].
            even=bool((taken == self.sizes()).all(axis=1).any()),
        )

    def next_sizes(self, look: Look, k: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Return the number of draws of each stratum before the next look, int64 [strata].

        k: events [rates, strata]. n: valid draws [strata]. Numbers never decrease. With allocation
        `neyman`, the planned total is distributed among the strata that `look` is waiting for. If
        `of` is "whole", it is distributed in proportion to size times standard deviation of the
        rate (Neyman 1934). If `of` is "groups", it is distributed in proportion to the variance, so
        that the widest interval becomes as narrow as possible. No stratum then gets more draws than
        it probably needs. If there are several rates, the one with the largest variance counts.
        Each number is at last rounded up to a planned size.
        """
        # Row `look.number` is that of the next look, because looks count from 1.
        sizes, counts = self.sizes(), np.array(list(look.taken.values()), np.int64)
        if self.allocation == "proportional":
            return np.maximum(counts, sizes[look.number])
        is_waiting = self._select(*look.waiting)
        # A stratum without an event so far may still have some (Agresti, Coull).
        rate = ((k + 2) / (n + 4)).clip(0, 1)
        deviation = np.sqrt(rate * (1 - rate)).max(axis=0)
        weight = deviation**2 if self.of == "groups" else deviation * self.size
        needed = np.minimum(sizes[-1], counts + self._needed_draws(k, n))
        allocated = allocate_runs(
            int(sizes[look.number].sum()),
            weight=np.where(is_waiting, weight, 0.0),
            least=counts,
            most=np.where(is_waiting, needed, counts),
        )
        # The smallest planned size that is large enough. Too small ones become the largest one.
        return np.where(sizes >= allocated, sizes, sizes[-1]).min(axis=0)

    def _needed_draws(self, k: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Return how many more draws each stratum probably needs, at least 1: int64 [strata]. k:
        events [rates, strata]. n: valid draws [strata].
        """
        # A rate of the whole table does not limit a single stratum, which may need all its draws.
        if self.of == "whole":
            return self.size
        alpha = alpha_of(self.each)
        low, high = anytime_bounds(k, n, alpha, self.half_width)
        # The rate may move within its interval towards one half, where a rate is hardest to
        # estimate. At the rate `worst`, a draw adds about half_width^2 / (2 worst (1 - worst)) to
        # a log likelihood ratio of `anytime_bounds`, which has to reach log(2 / alpha).
        worst = np.minimum(np.maximum(0.5, low), high)
        needed = 2 * math.log(2 / alpha) * worst * (1 - worst) / self.half_width**2
        return np.maximum(1, np.ceil(needed - n)).max(axis=0).astype(np.int64)

    def _select(self, *names: str) -> np.ndarray:
        # Returns the judged strata with one of these names, bool [strata]; "" names all strata.
        return self.judged & ["" in names or stratum.name in names for stratum in self.strata]

    def _intervals(self, k: np.ndarray, n: np.ndarray, taken: np.ndarray) -> Iterator[Interval]:
        """Yield the interval of each rate, for each judged stratum or for the whole table. k:
        events [rates, strata]. n: valid draws [strata]. taken: computed draws [strata].
        """
        judged = np.flatnonzero(self.judged)
        names, runs = [self.strata[index].name for index in judged], n[judged]
        for rate_name, hits in zip(self.rates, k[:, judged], strict=True):
            if self.of == "groups":
                rates = rates_with_intervals(hits, runs, self.each, half_width=self.half_width)
                rate_by_stratum = dict(zip(names, rates, strict=True))
            # If a stratum has no valid draw, the rate of the whole table is unknown.
            elif not (runs > 0).all():
                rate_by_stratum = {"": Rate()}
            else:
                # Of a stratum's size, only the share of draws with a valid run counts.
                weight = self.size[judged] * runs / taken[judged]
                estimate = stratified_rate(hits, runs, weight, self.each, self.half_width)
                rate_by_stratum = {"": Rate(int(hits.sum()), int(runs.sum()), *estimate)}
            for stratum, rate in rate_by_stratum.items():
                yield Interval(rate=rate_name, stratum=stratum, **rate._asdict())


def describe_stop(looks: Sequence[Look]) -> str:
    """Return a sentence that says why a campaign stopped, or did not stop, after these looks."""
    return resources.render_text(Path(__file__).with_suffix(".j2"), looks=looks)


def stratified_rate(
    k: ArrayLike,
    n: ArrayLike,
    weight: ArrayLike,
    confidence: float = 0.95,
    half_width: float | None = None,
) -> Estimate:
    """Return a rate over several strata, the sum of w[s] k[s]/n[s], with its confidence interval.
    With `half_width` the interval is `anytime_bounds` instead of Wilson's.

    Stratum s has k[s] hits in n[s] runs. Its share of the population is w[s]: weight[s] divided by
    the sum of all weights. The arguments are arrays [strata]; each weight and each n is above 0.

    Estimate and variance are from Powell, Martins, Arlat, Crouzet (IEEE Trans. Computers 44, 1995).
    The interval is Wilson's with the effective number of runs (Korn, Graubard, Survey Methodology
    24, 1998; Dean, Pagano, J. Surv. Stat. Methodol. 3, 2015), with which a plain sample has the
    same variance. The variance uses the centre of each stratum's Wilson interval, so that it is not
    0 if a stratum had no hit. For one stratum the interval is Wilson's.
    """
    from scipy.stats import norm

    hits, runs, weights = np.asarray(k), np.asarray(n), np.asarray(weight, float)
    share = weights / weights.sum()
    alpha = alpha_of(confidence)
    z = norm.isf(alpha / 2)
    centre = (hits + z**2 / 2) / (runs + z**2)
    overall = share @ centre
    # The number of runs with which a plain sample has the variance of this estimate.
    effective = overall * (1 - overall) / np.sum(share**2 * centre * (1 - centre) / runs)
    value = float(share @ (hits / runs))
    effective_counts = np.array(value * effective), np.array(effective)
    low, high = rate_bounds(*effective_counts, alpha, half_width=half_width)
    return Estimate(value, float(low), float(high))


def allocate_runs(total: int, weight: ArrayLike, least: ArrayLike, most: ArrayLike) -> np.ndarray:
    """Return runs per stratum, int64 [strata], in proportion to weight[s], between least[s] and
    most[s]. Their sum is `total`, or the nearest sum that the bounds allow. Runs that strata with a
    weight cannot have are divided evenly among the strata without a weight.
    """
    weights, low, high = np.asarray(weight, float), np.asarray(least), np.asarray(most)
    total = int(np.clip(total, low.sum(), high.sum()))
    # If there are too many runs for the strata with a weight, these get all that they may, which
    # is their lower bound while the other runs are divided.
    full = np.where(weights > 0, high, low)
    if total > full.sum():
        return allocate_runs(total, np.ones(len(weights)), full, high)
    # Find the factor f for which the sum of clip(f * weights, low, high) is the total. The sum is
    # linear between `corners`, the factors at which a stratum reaches a bound.
    bounds = np.stack([low, high])[:, weights > 0] / weights[weights > 0]
    corners = np.unique(np.append(0.0, bounds))
    sums = np.clip(corners[:, None] * weights, low, high).sum(axis=1)
    exact = np.clip(np.interp(total, sums, corners) * weights, low, high)
    runs = np.floor(exact).astype(np.int64)
    # Runs that rounding removed go to the strata with the largest remainders.
    by_remainder = np.argsort(runs - exact, kind="stable")
    runs[by_remainder[: total - int(runs.sum())]] += 1
    return runs
