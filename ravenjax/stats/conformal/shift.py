"""Tests whether new fault-free operations still resemble those of a calibration.

A unit is an independent draw, such as an operator. Null hypothesis: new units were drawn like those
of the calibration, all independent, so that each order of their scores is equally likely. A new
score then has a conformal p-value that is uniform (Vovk, Gammerman, Shafer, Algorithmic learning in
a random world, 2005). Two tests are valid for any distribution:

- The exact Kolmogorov-Smirnov test between new scores and calibration scores. It detects any
  change of their distribution.
- A martingale that bets against uniform p-values in their order of arrival: the simple jumper
  (Vovk et al., Conformal and probabilistic prediction, PMLR 152, 2021). By Ville's inequality
  its largest value exceeds 1/level with a probability of at most the level, at any time.

The tests are combined by Bonferroni's inequality. Each unit contributes one operation, because
operations of the same operator or robot are not independent. A single robot with many operations is
one draw of a robot.
"""

from typing import Any, NamedTuple

import numpy as np

JUMP = 0.01
"""Share of the capital that changes its bet at each step, as in the publication."""
BETS = (-1.0, 0.0, 1.0)


class Shift(NamedTuple):
    """The test results for one score."""

    p: float  # both tests together; at or below the level: shifted
    p_distribution: float  # Kolmogorov-Smirnov
    martingale: float  # largest value of the martingale
    # Median rank of the new scores among the calibration's, 0..1; about 0.5 if nothing changed.
    place: float
    fresh: int  # number of new units
    calibration: int  # number of units of the calibration


def test_shift(calibration: np.ndarray, fresh: np.ndarray, seed: int = 0) -> Shift:
    """Test whether scores of new units [fresh] have the distribution of those of the calibration
    [calibration]. Units are independent. `seed` breaks ties at random.
    """
    from scipy.stats import ks_2samp  # slow to import

    pooled = np.concatenate([calibration, fresh])
    jitter = np.random.default_rng(seed).random(len(pooled))
    rank = np.empty(len(pooled))
    rank[np.lexsort((jitter, pooled))] = np.arange(len(pooled))
    own, other = rank[: len(calibration)], rank[len(calibration) :]
    comparison: Any = ks_2samp(own, other, method="auto")
    p_distribution = float(comparison.pvalue)
    peak = float(martingale_capital(p_values(calibration, fresh, seed)).max(initial=1.0))
    place = np.searchsorted(np.sort(own), other) / len(own)
    return Shift(
        p=min(1.0, 2.0 * min(p_distribution, 1.0 / peak)),
        p_distribution=p_distribution,
        martingale=peak,
        place=float(np.median(place)),
        fresh=len(fresh),
        calibration=len(calibration),
    )


def p_values(calibration: np.ndarray, fresh: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return the conformal p-value of each new score, [fresh].

    A score is compared with the scores of the calibration and with earlier new scores. Under the
    null hypothesis p-values are independent and uniform on 0..1. High scores have small p-values.
    """
    theta = np.random.default_rng([seed, 1]).random(len(fresh))
    before = np.sort(np.asarray(calibration, float))
    out = np.empty(len(fresh))
    for i, score in enumerate(np.asarray(fresh, float)):
        low, high = np.searchsorted(before, score, "left"), np.searchsorted(before, score, "right")
        # The score itself is counted among its equals.
        above, alike = len(before) - high, high - low + 1
        out[i] = (above + theta[i] * alike) / (len(before) + 1)
        before = np.insert(before, high, score)
    return out


def martingale_capital(p: np.ndarray) -> np.ndarray:
    """Return the capital of the simple jumper after each p-value, [p]. It begins at 1."""
    shares = np.full(len(BETS), 1.0 / len(BETS))
    bets, path = np.array(BETS), np.empty(len(p))
    for i, value in enumerate(p):
        shares = (1 - JUMP) * shares + JUMP * shares.sum() / len(BETS)
        shares = shares * (1.0 + bets * (value - 0.5))
        path[i] = shares.sum()
    return path
