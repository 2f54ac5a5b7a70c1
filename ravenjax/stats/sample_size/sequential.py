"""Decides at planned looks whether a study may stop, with intervals that remain valid.

A user who looks at m sample sizes and stops at a convenient one has m chances to be wrong.
Therefore the sizes that each stratum may ever have are fixed before the first run, one for each
look. Every interval has confidence 1 - (1 - confidence) / (looks x strata x rates). By Bonferroni's
inequality, the intervals of all rates in all strata at all sizes are valid together with the wanted
confidence. This includes sizes that depend on the data, because the study stopped or gave one
stratum more draws than another. Each interval is exact (Clopper, Pearson, Biometrika 26, 1934).

The rate of all strata together is weighted by their sizes. Its interval is the
effective-sample-size Wilson interval of `stratified_rate`, at 1 - (1 - confidence) / (looks x
rates). This interval is approximate.

Runs count as independent draws. A table that is itself the population, such as a shuffled grid, is
drawn without replacement. Its intervals are therefore wider than necessary.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer

from ravenjax.bundled import resources
from ravenjax.stats.intervals import Estimate, Rate, alpha_of, rate_bounds, rates_with_intervals

Of = Literal["groups", "whole"]
Allocation = Literal["proportional", "neyman"]


class Stratum(NamedTuple):
    """A part of the table that is sampled separately, in the order of its draws."""

    name: str
    size: int  # number of draws that it holds
    # Whether its rates count. If not, the whole stratum is taken at the first look.
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
        """Return the half-width as a fraction; 1 if no run was valid."""
        return (self.high - self.low) / 2 if self.n else 1.0


class Look(BaseModel):
    """The result and the decision of one look."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    number: int  # from 1
    looks: int  # largest number of looks
    taken: dict[str, int]  # draws taken from each stratum
    # Draws that the table has of each stratum: the weights of a rate over several.
    held: dict[str, int]
    intervals: tuple[Interval, ...]
    # Largest half-width of the strata still waited for, else of all; fraction.
    widest: _Number
    # Strata that are neither narrow enough nor completely computed; "" is the whole table.
    waiting: tuple[str, ...]
    stop: bool
    half_width: float  # wanted half-width, fraction
    each: _Number  # confidence of each interval
    even: bool  # the same share of every stratum was taken


@dataclasses.dataclass(frozen=True)
class Sequential:
    """The stopping rule: what is judged, how narrow it must get, and at which sizes."""

    strata: tuple[Stratum, ...]
    rates: tuple[str, ...]
    half_width: float  # fraction
    shares: tuple[float, ...]  # of each stratum, at each look, increasing
    confidence: float = 0.95
    of: Of = "groups"
    allocation: Allocation = "proportional"

    @property
    def size(self) -> np.ndarray:
        """Return the number of draws that each stratum holds, int64 [strata]."""
        return np.array([stratum.size for stratum in self.strata], np.int64)

    @property
    def judged(self) -> np.ndarray:
        """Return which strata are judged, bool [strata]."""
        return np.array([stratum.judged and stratum.size > 0 for stratum in self.strata])

    @property
    def each(self) -> float:
        """Return the confidence of each interval."""
        apart = int(self.judged.sum()) if self.of == "groups" else 1
        return 1 - alpha_of(self.confidence) / (len(self.shares) * apart * len(self.rates))

    def sizes(self) -> np.ndarray:
        """Return the draws of each stratum that may ever be taken, int64 [looks, strata]; at least
        one.
        """
        part = np.ceil(np.outer(self.shares, self.size) - 1e-9).astype(np.int64)
        return np.where(self.judged, np.clip(part, np.minimum(1, self.size), self.size), self.size)

    def first(self) -> np.ndarray:
        """Return the draws of each stratum before the first look, int64 [strata]."""
        return self.sizes()[0]

    def look(self, number: int, taken: np.ndarray, k: np.ndarray, n: np.ndarray) -> Look:
        """Return the decision after look `number` (from 1), with k[rate, stratum] events in
        n[stratum] valid draws.

        `taken`: draws of each stratum; must be registered sizes.
        """
        names = [stratum.name for stratum in self.strata]
        intervals = list(self._intervals(k, n, taken))
        wide = [
            one
            for one in intervals
            if one.half_width > self.half_width and not self._exhausted(one, taken)
        ]
        waiting = tuple(dict.fromkeys(one.stratum for one in wide))
        widest = max((one.half_width for one in wide or intervals), default=0.0)
        stop = not waiting or number == len(self.shares)
        return Look(
            number=number,
            looks=len(self.shares),
            taken=dict(zip(names, taken.tolist(), strict=True)),
            held=dict(zip(names, self.size.tolist(), strict=True)),
            intervals=tuple(intervals),
            widest=widest,
            waiting=waiting,
            stop=stop,
            half_width=self.half_width,
            each=self.each,
            even=bool((taken == self.sizes()).all(axis=1).any()),
        )

    def following(self, look: Look, k: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Return the draws of each stratum before the next look, int64 [strata]. No number falls
        below what was taken.

        With allocation `neyman`, the total of the next share is distributed to narrow the judged
        rates most. Draws are in proportion to size times spread (Neyman 1934). For strata that are
        judged separately they are in proportion to the square of the spread, which makes the widest
        interval narrowest. Of several rates the largest spread counts. A stratum that is not waited
        for gets no draws. A stratum that is judged separately gets at most what it probably needs.
        Then each number is rounded up to a registered size.
        """
        sizes, counts = self.sizes(), np.array(list(look.taken.values()), np.int64)
        if self.allocation == "proportional":
            return np.maximum(counts, sizes[look.number])
        waits = self.judged & np.array(
            [{stratum.name, ""} & set(look.waiting) != set() for stratum in self.strata]
        )
        # A stratum without an event so far may still have some (Agresti, Coull).
        guess = ((k + 2) / (n + 4)).clip(0, 1)
        spread = np.sqrt(guess * (1 - guess)).max(axis=0)
        spread = spread**2 if self.of == "groups" else spread * self.size
        most = np.where(waits, np.minimum(sizes[-1], counts + self._more(k, n)), counts)
        wanted = allocate_runs(
            int(sizes[look.number].sum()), np.where(waits, spread, 0.0), counts, most
        )
        return np.where(sizes >= wanted, sizes, sizes[-1]).min(axis=0)

    def _more(self, k: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Return how many further draws of each stratum probably suffice, at least 1."""
        if self.of == "whole":
            return self.size
        low, high = rate_bounds(k, n, alpha_of(self.each))
        # The rate may move within its interval towards one half, where a rate is hardest to
        # estimate.
        worst = np.minimum(np.maximum(0.5, low), high)
        more = wilson_runs(worst, self.half_width, self.each) - n
        return np.where(n > 0, np.maximum(1, more).max(axis=0), self.size).astype(np.int64)

    def _exhausted(self, one: Interval, taken: np.ndarray) -> bool:
        of_it = self.judged & np.array(
            [one.stratum in ("", stratum.name) for stratum in self.strata]
        )
        return bool((taken >= self.size)[of_it].all())

    def _intervals(self, k: np.ndarray, n: np.ndarray, taken: np.ndarray) -> Iterator[Interval]:
        there = np.flatnonzero(self.judged)
        names, runs = [self.strata[s].name for s in there], n[there]
        for rate, hits in zip(self.rates, k[:, there], strict=True):
            if self.of == "groups":
                found = dict(
                    zip(names, rates_with_intervals(hits, runs, self.each, "beta"), strict=True)
                )
            # A stratum without any valid draw leaves the rate of the whole table unknown.
            elif not (runs > 0).all():
                found = {"": Rate()}
            else:
                # Draws that do not count, such as faults that never act, are no part of the table.
                weight = self.size[there] * runs / taken[there]
                estimate = stratified_rate(hits, runs, weight, self.each)
                found = {"": Rate(int(hits.sum()), int(runs.sum()), *estimate)}
            for name, one in found.items():
                yield Interval(rate=rate, stratum=name, **one._asdict())


def describe_stop(looks: Sequence[Look]) -> str:
    """Return a sentence on why a campaign stopped, or that it has not. `looks`: in order."""
    return resources.render_text(Path(__file__).with_name("stop.j2"), looks=looks)


def stratified_rate(
    k: ArrayLike, n: ArrayLike, weight: ArrayLike, confidence: float = 0.95
) -> Estimate:
    """Return the rate sum of w[s] k[s]/n[s] over strata, with its confidence interval.

    Stratum s has k[s] hits in n[s] runs. Its share of the population is w[s]: weight[s] divided by
    the sum of all weights. The arguments are arrays [strata]; each weight and each n is above 0.

    Estimate and variance are from Powell, Martins, Arlat, Crouzet (IEEE Trans. Computers 44, 1995).
    The interval is Wilson's at the effective number of runs (Korn, Graubard, Survey Methodology 24,
    1998; Dean, Pagano, J. Surv. Stat. Methodol. 3, 2015). A plain sample with that number of runs
    has the same variance. The variance is computed at each stratum's Wilson centre, so that the
    interval does not collapse if a stratum had no hit. For one stratum the interval is Wilson's.
    """
    from scipy.stats import norm

    hits, runs, weights = np.asarray(k), np.asarray(n), np.asarray(weight, float)
    share = weights / weights.sum()
    alpha = alpha_of(confidence)
    z = norm.isf(alpha / 2)
    centre = (hits + z**2 / 2) / (runs + z**2)
    overall = share @ centre
    effective = overall * (1 - overall) / np.sum(share**2 * centre * (1 - centre) / runs)
    value = float(share @ (hits / runs))
    low, high = rate_bounds(np.array(value * effective), np.array(effective), alpha)
    return Estimate(value, float(low), float(high))


def allocate_runs(total: int, spread: ArrayLike, least: ArrayLike, most: ArrayLike) -> np.ndarray:
    """Return runs per stratum, int64 [strata], in proportion to spread[s], between least[s] and
    most[s].

    They sum to `total`, or to the nearest sum that the bounds allow. If strata without spread must
    take what the others cannot hold, they share it evenly.
    """
    want, low, high = np.asarray(spread, float), np.asarray(least), np.asarray(most)
    total = int(np.clip(total, low.sum(), high.sum()))
    full = np.where(want > 0, high, low)
    if total > full.sum():
        return allocate_runs(total, np.ones(len(want)), full, high)
    # The level at which the clipped multiples of the spreads sum to the total.
    bounds = np.stack([low, high])[:, want > 0] / want[want > 0]
    corners = np.unique(np.append(0.0, bounds))
    sums = np.clip(corners[:, None] * want, low, high).sum(axis=1)
    exact = np.clip(np.interp(total, sums, corners) * want, low, high)
    runs = np.floor(exact).astype(np.int64)
    # Distribute by remainders, the largest first.
    largest = np.argsort(runs - exact, kind="stable")
    runs[largest[: total - int(runs.sum())]] += 1
    return runs


def wilson_runs(rate: np.ndarray, half_width: float, confidence: float) -> np.ndarray:
    """Return the fewest runs with which a Wilson interval around each rate is +- half_width
    (fraction) or narrower; whole numbers, NaN for a rate that is NaN.

    With z the normal quantile, the interval's half-width is z sqrt(p (1 - p) / n + (z / 2 n)^2) /
    (1 + z^2 / n), which falls with n. Setting it to half_width gives a quadratic equation in n with
    one positive root.
    """
    from scipy.special import ndtri

    z, square = float(ndtri(1 - alpha_of(confidence) / 2)), half_width**2
    excess = rate * (1 - rate) - 2 * square
    root = z**2 * (excess + np.sqrt(excess**2 + square * (1 - 4 * square))) / (2 * square)
    # An excess that is only floating-point rounding does not add a run.
    return np.maximum(1, np.ceil(root * (1 - 1e-9)))
