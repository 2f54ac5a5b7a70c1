"""Two variants over the same faults under the same random numbers, compared run by run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap.resample import BootstrapBand, bootstrap
from ravenjax.stats.intervals import Estimate, alpha_of


class Discordance(NamedTuple):
    """Pairs in which only one variant hit, and McNemar's exact p-value that both are alike."""

    first_only: int
    second_only: int
    n: int
    p: float


def mcnemar(first: ArrayLike, second: ArrayLike) -> Discordance:
    """McNemar's exact test of two bool [n] over the same runs; p is 1 where no pair is discordant.

    ValueError where the lengths differ.
    """
    from scipy.stats import binomtest

    one, two = _pairs(first, second, bool)
    only, other = int((one & ~two).sum()), int((two & ~one).sum())
    p = binomtest(only, only + other).pvalue if only + other else 1.0
    return Discordance(only, other, len(one), float(p))


def rate_difference(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Rate of `first` minus rate of `second`, two bool [n] over the same runs, with its interval;
    NaN where n is 0.

    Adjusted Wald interval of Bonett and Price (J. Educ. Behav. Stat. 37, 2012), recommended by
    Fagerland, Lydersen and Laake (Stat. Med. 33, 2014); no library at hand has an interval for
    pairs. ValueError where the lengths differ.
    """
    one, two = _pairs(first, second, bool)
    return difference_of_counts(
        int((one & ~two).sum()), int((two & ~one).sum()), len(one), confidence
    )


def difference_of_counts(
    first_only: ArrayLike, second_only: ArrayLike, n: int, confidence: float = 0.95
) -> Estimate:
    """As `rate_difference`, of how many of `n` pairs hit in the first variant only, and in the
    second only: numbers, or arrays of one shape.

    ValueError where these are no counts of n pairs.
    """
    from scipy.stats import norm

    first, second = np.asarray(first_only), np.asarray(second_only)
    if min(first.min(initial=0), second.min(initial=0)) < 0 or (first + second > n).any():
        raise ValueError(f"{first_only} and {second_only} discordant pairs of {n}")
    if not n:
        return Estimate(np.nan, np.nan, np.nan)
    z = norm.isf(alpha_of(confidence) / 2)
    p, q = (first + 1) / (n + 2), (second + 1) / (n + 2)
    half = z * np.sqrt((p + q - (p - q) ** 2) / (n + 2))
    parts = (first - second) / n, np.maximum(p - q - half, -1.0), np.minimum(p - q + half, 1.0)
    return Estimate(*(part if part.ndim else float(part) for part in parts))


def mean_difference(
    first: ArrayLike,
    second: ArrayLike,
    confidence: float = 0.95,
    *,
    resamples: int = 5000,
    seed: int = 0,
) -> BootstrapBand:
    """Mean of first - second, two numbers [n] of the same runs in any unit, with its bootstrap
    band; Band.units is n.

    ValueError where the lengths differ, a value is not finite, or there are fewer than 2 pairs.
    """
    one, two = _pairs(first, second, float)
    difference = one - two
    if not np.isfinite(difference).all():
        raise ValueError(
            f"mean_difference: {int((~np.isfinite(difference)).sum())} pairs have a value that is"
            " not finite"
        )
    batch = max(1, 2_000_000 // max(1, len(difference)))
    return bootstrap(
        len(difference),
        lambda index: difference[index].mean(axis=-1),
        confidence,
        resamples=resamples,
        seed=seed,
        batch=batch,
    )


def _pairs(first: ArrayLike, second: ArrayLike, kind: type) -> tuple[np.ndarray, np.ndarray]:
    one, two = np.asarray(first).astype(kind), np.asarray(second).astype(kind)
    if one.shape != two.shape or one.ndim != 1:
        raise ValueError(f"pairs come one by one: got shapes {one.shape} and {two.shape}")
    return one, two
