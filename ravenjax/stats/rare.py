"""The probability of an event too rare to be met by chance.

A limit state g maps unit-cube points [n, d] to margins [n]; the event is margin <= 0. Each
coordinate is the quantile of an independent input. g is called with batches and must give the same
margin for the same point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.stats.intervals import alpha_of, rates

LimitState = Callable[[np.ndarray], np.ndarray]

_MOST_LEVELS = 12


class RareEvent(NamedTuple):
    """Probability of the event with its interval; cov: coefficient of variation of the estimate
    (NaN where no event was met); runs: evaluations of the limit state; levels: margins that subset
    simulation went through, falling."""

    probability: float
    low: float
    high: float
    cov: float
    runs: int
    levels: tuple[float, ...] = ()


def monte_carlo(
    g: LimitState, d: int, n: int, *, seed: int = 0, batch: int = 10_000, confidence: float = 0.95
) -> RareEvent:
    """Plain Monte Carlo with n points, at most `batch` at a time; Clopper-Pearson interval.

    Needs some 100 / probability runs for a cov of 10 %. The result does not depend on batch.
    ValueError where g returns NaN.
    """
    random = np.random.default_rng(seed)
    hits = sum(
        int((_margins(g, random.random((min(batch, n - start), d))) <= 0).sum())
        for start in range(0, n, batch)
    )
    (rate,) = rates(hits, n, confidence, "clopper_pearson")
    cov = math.sqrt((1 - rate.value) / hits) if hits else math.nan
    return RareEvent(rate.value, rate.low, rate.high, cov, n)


def subset(
    g: LimitState,
    d: int,
    per_level: int = 1000,
    *,
    share: float = 0.1,
    seed: int = 0,
    confidence: float = 0.95,
) -> RareEvent:
    """Subset simulation (Au, Beck, Prob. Eng. Mech. 16, 2001) by OpenTURNS: each level keeps the
    `share` of the per_level points with the least margins and walks on from them, so 1e-6 costs
    some 6 levels.

    g is called with batches of per_level * share points: as many chains as there are seeds, of 1 /
    share steps each. The cov counts the correlation along the chains as far as Au and Beck do, and
    is somewhat too small; the interval is lognormal with it (one level alone: Clopper-Pearson).
    The margin must show how near a run is to the event. Where the event is not reached in 12
    levels, since it is rarer, impossible, or the margin is flat, the probability is given as 0,
    and the upper bound is what the first level's independent points assure. Check it against
    `monte_carlo` where the event has a probability of 1e-2 to 1e-3. Deterministic by seed; the
    state of OpenTURNS' generator is left as it was. per_level * share and 1 / share are whole
    numbers of at least 2. ValueError where g returns NaN; UserError where OpenTURNS is not
    installed.
    """
    from scipy.stats import lognorm

    alpha = alpha_of(confidence)
    chains = round(per_level * share)
    try:
        import openturns as ot  # slow to import, and an extra
    except ImportError:
        raise UserError(
            "subset simulation needs OpenTURNS, which is not installed: pip install"
            ' "ravenjax[rare]"; or take plain Monte Carlo'
        ) from None
    runs = 0
    failure: BaseException | None = None

    def margins(points: object) -> np.ndarray:
        nonlocal runs, failure
        try:
            if runs >= _MOST_LEVELS * per_level:
                raise _Unreached
            values = _margins(g, np.asarray(points))
        except BaseException as error:  # a signal, too: OpenTURNS passes on its text only
            failure = error
            raise _Ended from None
        runs += len(values)
        return values[:, None]

    inputs = ot.RandomVector(ot.JointDistribution([ot.Uniform(0.0, 1.0)] * d))
    event = ot.ThresholdEvent(
        ot.CompositeRandomVector(ot.PythonFunction(d, 1, func_sample=margins), inputs),
        ot.LessOrEqual(),
        0.0,
    )
    algorithm = ot.SubsetSampling(event)
    algorithm.setConditionalProbability(share)
    # one block, one step of every chain: larger blocks repeat seeds and leave chains of one step,
    # with twice the error
    algorithm.setBlockSize(chains)
    algorithm.setMaximumOuterSampling(round(1 / share))
    state = ot.RandomGenerator.GetState()
    try:
        ot.RandomGenerator.SetSeed(seed)
        algorithm.run()
    except Exception:
        if isinstance(failure, _Unreached):
            (none,) = rates(0, per_level, confidence, "clopper_pearson")
            return RareEvent(0.0, 0.0, none.high, math.nan, runs)
        if failure is not None:
            raise failure from None
        if (
            0.0 not in algorithm.getThresholdPerStep()
        ):  # reached, but a last level of events alone has no variance for it
            raise
    finally:
        ot.RandomGenerator.SetState(state)
    levels = tuple(algorithm.getThresholdPerStep())
    reached = np.array(algorithm.getProbabilityEstimatePerStep())
    probability = float(reached[-1])
    if len(levels) == 1:
        (rate,) = rates(round(probability * per_level), per_level, confidence, "clopper_pearson")
        cov = math.sqrt((1 - probability) / (probability * per_level))
        return RareEvent(rate.value, rate.low, rate.high, cov, runs, levels)
    # Au and Beck's sum over all levels; OpenTURNS leaves the first one out of its own
    step = reached / np.append(1.0, reached[:-1])
    correlation = np.nan_to_num(
        np.array(algorithm.getGammaPerStep())
    )  # nan where step is 1, which has no variance
    cov = math.sqrt(np.sum((1 + correlation) * (1 - step) / (step * per_level)))
    low, high = lognorm.ppf(
        [alpha / 2, 1 - alpha / 2], math.sqrt(math.log1p(cov**2)), scale=probability
    )
    return RareEvent(probability, float(low), min(1.0, float(high)), cov, runs, levels)


class _Ended(Exception):
    """`failure` has ended the sampling."""


class _Unreached(Exception):
    """The largest number of levels passed without an event."""


def _margins(g: LimitState, points: np.ndarray) -> np.ndarray:
    margins = np.asarray(g(points), float)
    if np.isnan(margins).any():
        raise ValueError(
            f"{int(np.isnan(margins).sum())} margins are NaN; give a failed run the margin that it"
            " stands for"
        )
    return margins
