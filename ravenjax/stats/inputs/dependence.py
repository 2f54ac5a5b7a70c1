"""Whether a rate depends on an input, over units of rows: kinds of faults, or robots. Units are
counted, not rows.

Either the input was drawn for each row, and rows of one unit resemble each other (each fault on a
robot of its own, and faults come in kinds), or each unit has one value (robots that several faults
share).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap.resample import quantiles
from ravenjax.stats.bootstrap.units import FEWEST, Units
from ravenjax.stats.intervals import Estimate, Rate, rate_difference, share, wilson
from ravenjax.stats.multiplicity import holm

_DRAWS = 9999
# With at least this many units the normal law replaces draws.
_MANY = 50


class InputLevel(NamedTuple):
    """Runs of one level of an input: its name, the input's least and greatest value there."""

    name: str
    least: float
    greatest: float
    rate: Rate


class Dependence(NamedTuple):
    """Whether a rate depends on one input.

    levels: the lowest, (middle) and highest third of the input. difference: rate in the last level
    minus rate in the first. p: of independence, NaN where the input or the outcome never varies;
    adjusted: by Holm over all inputs asked about; depends: adjusted p below 1 - confidence.
    """

    name: str
    n: int  # runs in which the input has a value
    p: float
    adjusted: float
    depends: bool
    levels: tuple[InputLevel, ...]
    difference: Estimate


def dependences(
    hit: ArrayLike,
    inputs: Mapping[str, ArrayLike],
    among: Units,
    confidence: float = 0.95,
    seed: int = 0,
) -> list[Dependence]:
    """Whether the rate of `hit` (bool [n]) depends on each numeric input [n], over units of rows;
    the clearest first.

    Rates by thirds of the input and the difference of the outer ones have intervals that resample
    units. p is twice the lesser of two tests' (Bonferroni), of a rate that rises or falls and of
    one that is worst in the middle or at both ends: values of the input are exchanged among the
    rows of each unit, or among units where each has one value. Below FEWEST units there are
    neither. A row without a value (NaN) is left out of that input.
    """
    outcome = np.asarray(hit).astype(bool)
    measured = [
        _measured(name, outcome, np.asarray(x, float), among, confidence, seed)
        for name, x in inputs.items()
    ]
    return judge(measured, confidence)


def judge(measured: Sequence[Dependence], confidence: float) -> list[Dependence]:
    """The same with p adjusted for all of them, the clearest first."""
    findings = holm({one.name: one.p for one in measured}, confidence)
    results = [
        one._replace(adjusted=findings[one.name].adjusted, depends=findings[one.name].rejected)
        for one in measured
    ]
    return sorted(results, key=lambda one: (np.isnan(one.p), one.p, -abs(one.difference.value)))


def _measured(
    name: str, hit: np.ndarray, values: np.ndarray, among: Units, confidence: float, seed: int
) -> Dependence:
    present = ~np.isnan(values)
    hit, values, among = hit[present], values[present], among.where(present)
    code, names = thirds(values)
    cell = among.unit * len(names) + code
    n, k = (
        np.bincount(cell, mask, among.count * len(names)).reshape(-1, len(names))
        for mask in (None, hit)
    )
    filled = [i for i in range(len(names)) if n[:, i].any()]
    samples = np.full((1, len(names)), np.nan)
    if among.count >= FEWEST:
        weight = among.weights(seed=seed)
        with np.errstate(invalid="ignore"):
            samples = (weight @ k) / (weight @ n)
    levels = tuple(
        InputLevel(
            names[i],
            values[code == i].min(),
            values[code == i].max(),
            _rate(k[:, i], n[:, i], samples[:, i], confidence),
        )
        for i in filled
    )
    difference = Estimate(np.nan, np.nan, np.nan)
    if len(filled) > 1:
        low, high = filled[0], filled[-1]
        difference = _difference(
            (k[:, high], n[:, high]),
            (k[:, low], n[:, low]),
            samples[:, high] - samples[:, low],
            confidence,
        )
    p = _p(hit, values, among, seed)
    return Dependence(name, len(hit), p, p, False, levels, difference)


def thirds(values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Level of each value [n] by its rank, int [n], and the levels' names: equal values stay
    together, and both extremes have a level of their own."""
    from scipy.stats import rankdata

    if not len(values) or values.min() == values.max():
        return np.zeros(len(values), int), ["constant"]
    place = (rankdata(values) - 0.5) / len(values)
    low, high = (
        (place < 1 / 3) | (values == values.min()),
        (place > 2 / 3) | (values == values.max()),
    )
    return np.where(low, 0, np.where(high, 2, 1)), ["lowest third", "middle third", "highest third"]


def _rate(k: np.ndarray, n: np.ndarray, samples: np.ndarray, confidence: float) -> Rate:
    """Rate of one level, with quantiles of its resamples; where all rows are alike, Wilson's
    interval with one trial per unit.
    """
    whole, count = share(int(k.sum()), int(n.sum())), int((n > 0).sum())
    if count < FEWEST:
        return whole
    if 0 < whole.k < whole.n:
        low, high = quantiles(samples, confidence).tolist()
    else:
        low, high = wilson(count if whole.k else 0, count, confidence)[-2:]
    return whole._replace(low=low, high=high)


def _difference(
    one: tuple[np.ndarray, np.ndarray],
    other: tuple[np.ndarray, np.ndarray],
    samples: np.ndarray,
    confidence: float,
) -> Estimate:
    """Rate of one level (hits and rows by unit) minus that of another. Where all rows of each are
    alike a resample can show nothing else: then the interval of one trial per unit."""
    sums = [(int(k.sum()), int(n.sum()), int((n > 0).sum())) for k, n in (one, other)]
    value = sums[0][0] / sums[0][1] - sums[1][0] / sums[1][1]
    if min(count for *_, count in sums) < FEWEST:
        return Estimate(value, math.nan, math.nan)
    if all(k in (0, n) for k, n, _ in sums):
        (k, _, m), (k0, _, m0) = sums
        return rate_difference(m if k else 0, m, m0 if k0 else 0, m0, confidence)
    return Estimate(value, *quantiles(samples, confidence).tolist())


def _p(hit: np.ndarray, values: np.ndarray, among: Units, seed: int) -> float:
    from scipy.stats import rankdata

    if among.count < FEWEST or np.ptp(values) == 0 or hit.all() or not hit.any():
        return math.nan
    rank = (rankdata(values) - 0.5) / len(values)
    scores = rank, (rank - rank.mean()) ** 2
    first = np.zeros(among.count)
    first[among.unit] = values
    if (first[among.unit] == values).all():
        rng = np.random.default_rng(seed)
        p = [_between(hit, score, among, rng) for score in scores]
    else:
        p = [_within(hit, score, among) for score in scores]
    finite = [one for one in p if not math.isnan(one)]
    return min(1.0, len(finite) * min(finite)) if finite else math.nan


def _within(hit: np.ndarray, score: np.ndarray, among: Units) -> float:
    """Scores exchanged among the rows of each unit: van Elteren's test with equal weights of rows
    (Stat. Neerl. 14, 1960; the correlation statistic of Landis, Heyman and Koch, Int. Stat. Rev.
    46, 1978)."""
    n = np.bincount(among.unit)
    apart = [x - (np.bincount(among.unit, x) / n)[among.unit] for x in (score, hit.astype(float))]
    squares = [np.bincount(among.unit, x**2) for x in apart]
    variance = float((squares[0] * squares[1] / np.maximum(n - 1, 1)).sum())
    return _normal(float(apart[0] @ apart[1]), variance)


def _between(hit: np.ndarray, score: np.ndarray, among: Units, rng: np.random.Generator) -> float:
    """Scores exchanged among units: the excess of hits of each unit times its score."""
    excess = np.bincount(among.unit, hit - hit.mean())
    of_unit = np.bincount(among.unit, score) / np.bincount(among.unit)
    of_unit = of_unit - of_unit.mean()
    own = float(of_unit @ excess)
    if among.count >= _MANY:
        return _normal(own, float((of_unit**2).sum() * (excess**2).sum() / (among.count - 1)))
    samples = rng.permuted(np.broadcast_to(of_unit, (_DRAWS, among.count)), axis=1) @ excess
    return float((1 + (np.abs(samples) >= abs(own) * (1 - 1e-9)).sum()) / (1 + _DRAWS))


def _normal(own: float, variance: float) -> float:
    """Two-sided; NaN without any variance."""
    from scipy.special import ndtr

    return float(2 * ndtr(-abs(own) / math.sqrt(variance))) if variance > 0 else math.nan
