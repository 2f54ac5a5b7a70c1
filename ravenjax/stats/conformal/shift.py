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
operations of the same operator or robot are not independent.
"""

from typing import Any, NamedTuple

import numpy as np

JUMP_SHARE = 0.01
"""Share of the capital that changes its bet at each step, as in the publication."""
BETS = (-1.0, 0.0, 1.0)
"""The bets: that p-values are small, uniform, or large."""


class Shift(NamedTuple):
    """The test results for one score."""

    p: float  # of both tests, by Bonferroni's inequality; at or below the level: shifted
    martingale: float  # largest value of the martingale
    # Median share of calibration scores below a new score; about 0.5 if nothing changed.
    median_rank: float


def test_shift(calibration_scores: np.ndarray, new_scores: np.ndarray, seed: int = 0) -> Shift:
    """Test whether scores of new units come from the same distribution as the calibration scores.

    Each array has one score per independent unit. A Kolmogorov-Smirnov test and a martingale test
    are combined by Bonferroni's inequality: the smaller p-value is doubled. `seed`: of the random
    numbers that put equal scores in order.
    """
    from scipy.stats import ks_2samp  # slow to import

    # The exact test needs distinct values. Ranks are distinct, with equal scores in random order.
    pooled = np.concatenate([calibration_scores, new_scores])
    tie_breakers = np.random.default_rng(seed).random(len(pooled))
    ranks = np.empty(len(pooled))
    # lexsort sorts by its last key, and by the first key where the last is equal.
    ranks[np.lexsort((tie_breakers, pooled))] = np.arange(len(pooled))
    calibration_count = len(calibration_scores)
    calibration_ranks, new_ranks = ranks[:calibration_count], ranks[calibration_count:]
    comparison: Any = ks_2samp(calibration_ranks, new_ranks, method="auto")
    capital = martingale_capital(p_values(calibration_scores, new_scores, seed))
    peak_capital = float(capital.max(initial=1.0))
    below = np.searchsorted(np.sort(calibration_ranks), new_ranks)
    return Shift(
        # 1 / peak_capital is the p-value of the martingale test, by Ville's inequality.
        p=min(1.0, 2.0 * min(float(comparison.pvalue), 1.0 / peak_capital)),
        martingale=peak_capital,
        median_rank=float(np.median(below / calibration_count)),
    )


def p_values(calibration_scores: np.ndarray, new_scores: np.ndarray, seed: int) -> np.ndarray:
    """Return the conformal p-value of each new score, [new scores], in their order of arrival.

    A score is compared with the calibration scores and with earlier new scores. Under the null
    hypothesis p-values are independent and uniform on 0..1. High scores have small p-values.
    `seed`: random numbers that put equal scores in order.
    """
    tie_breakers = np.random.default_rng([seed, 1]).random(len(new_scores))
    earlier = np.sort(np.asarray(calibration_scores, float))
    p = np.empty(len(new_scores))
    for i, score in enumerate(np.asarray(new_scores, float)):
        # `earlier` ascends: scores below this score, equal ones from `first_equal`, then above.
        first_equal = np.searchsorted(earlier, score, "left")
        first_above = np.searchsorted(earlier, score, "right")
        above_count = len(earlier) - first_above
        # The score itself is counted among its equals, of which a random share counts as above.
        equal_count = first_above - first_equal + 1
        p[i] = (above_count + tie_breakers[i] * equal_count) / (len(earlier) + 1)
        earlier = np.insert(earlier, first_above, score)
    return p


def martingale_capital(p: np.ndarray) -> np.ndarray:
    """Return the capital of the simple jumper after each p-value, [p]. It begins at 1. The capital
    is divided among BETS. A p-value of v multiplies the capital on bet b by 1 + b (v - 0.5). Before
    each p-value, JUMP_SHARE of the capital is divided again equally.
    """
    shares = np.full(len(BETS), 1.0 / len(BETS))
    bets, path = np.array(BETS), np.empty(len(p))
    for i, value in enumerate(p):
        shares = (1 - JUMP_SHARE) * shares + JUMP_SHARE * shares.sum() / len(BETS)
        shares = shares * (1.0 + bets * (value - 0.5))
        path[i] = shares.sum()
    return path
