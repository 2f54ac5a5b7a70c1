"""Estimates the probability of an event that is too rare for plain Monte Carlo sampling.

The event is defined by a function g, a limit state. It maps points of the unit cube [n, d] to
margins [n]. The event is margin <= 0. Each coordinate is the cumulative probability, 0 to 1, of an
independent input. g is called with batches of points. The same point must have the same margin.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.stats.intervals import clopper_pearson

LimitState = Callable[[np.ndarray], np.ndarray]

_MAX_LEVELS = 12
BATCH = 10_000


class RareEvent(NamedTuple):
    """Probability of the event with its 95 % interval. cov: coefficient of variation of the
    estimate; NaN if the event never happened. runs: number of evaluations of the limit state.
    levels: margins of the levels of subset simulation, falling.
    """

    probability: float
    low: float
    high: float
    cov: float
    runs: int
    levels: tuple[float, ...] = ()


def monte_carlo(g: LimitState, d: int, n: int, *, seed: int = 0) -> RareEvent:
    """Estimate the probability of the event by plain Monte Carlo, from n random points.

    g: limit state of d inputs; the event is a margin of at most 0. The interval is that of Clopper
    and Pearson. A cov (coefficient of variation) of 10 % needs about 100 / probability runs. Raise
    ValueError if g returns NaN.
    """
    random = np.random.default_rng(seed)
    hits = 0
    for start in range(0, n, BATCH):
        points = random.random((min(BATCH, n - start), d))
        hits += int((_margins(g, points) <= 0).sum())
    rate = clopper_pearson(hits, n)
    cov = math.sqrt((1 - rate.value) / hits) if hits else math.nan
    return RareEvent(rate.value, rate.low, rate.high, cov, n)


def subset_simulation(
    g: LimitState, d: int, per_level: int = 1000, *, share: float = 0.1, seed: int = 0
) -> RareEvent:
    """Estimate by subset simulation (Au, Beck, Prob. Eng. Mech. 16, 2001), with OpenTURNS.

    Each level has per_level points. The `share` of points with the smallest margins are the seeds
    of Markov chains of 1 / share steps, which make the next level. A probability of 1e-6 needs
    about 6 levels. g is called with batches of per_level * share points, one of each chain.

    The cov includes the correlation along chains as Au and Beck do, and is somewhat too small. The
    interval is lognormal with this cov; for a single level it is Clopper and Pearson's. The margin
    must show how near a run is to the event. If the event is not reached in 12 levels, it is rarer
    or impossible, or the margin is constant. The probability is then 0, with the upper bound from
    the independent points of the first level. Compare with `monte_carlo` for an event with a
    probability of 1e-2 to 1e-3.

    The result is deterministic for a seed, and the state of OpenTURNS' generator is restored.
    per_level * share and 1 / share must be whole numbers of at least 2. Raise ValueError if g
    returns NaN, and UserError if OpenTURNS is not installed.
    """
    from scipy.stats import lognorm

    chains = round(per_level * share)
    try:
        import openturns as ot  # slow to import, and an optional dependency
    except ImportError:
        raise UserError(
            "subset simulation needs OpenTURNS, which is not installed: pip install"
            ' "ravenjax[rare]"; or use plain Monte Carlo'
        ) from None
    runs = 0
    failure: BaseException | None = None

    def margins(points: object) -> np.ndarray:
        # Returns margins for OpenTURNS and counts runs. Ends the search after _MAX_LEVELS levels.
        nonlocal runs, failure
        if runs >= _MAX_LEVELS * per_level:
            raise RuntimeError("the event is not reached")
        try:
            values = _margins(g, np.asarray(points))
        # Also keeps KeyboardInterrupt, because OpenTURNS passes on only the text of an exception.
        except BaseException as error:
            failure = error
            raise
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
    # A block is one step of every chain. Larger blocks leave chains of one step: twice the error.
    algorithm.setBlockSize(chains)
    algorithm.setMaximumOuterSampling(round(1 / share))
    state = ot.RandomGenerator.GetState()
    try:
        ot.RandomGenerator.SetSeed(seed)
        algorithm.run()
    except Exception:
        if failure is not None:
            raise failure from None
        # If the event was reached, the error came from a last level that contains only events.
        if 0.0 not in algorithm.getThresholdPerStep():
            if runs < _MAX_LEVELS * per_level:
                raise
            return RareEvent(0.0, 0.0, clopper_pearson(0, per_level).high, math.nan, runs)
    finally:
        ot.RandomGenerator.SetState(state)
    levels = tuple(algorithm.getThresholdPerStep())
    reached = np.array(algorithm.getProbabilityEstimatePerStep())
    probability = float(reached[-1])
    if len(levels) == 1:
        rate = clopper_pearson(round(probability * per_level), per_level)
        cov = math.sqrt((1 - probability) / (probability * per_level))
        return RareEvent(rate.value, rate.low, rate.high, cov, runs, levels)
    # Au and Beck's sum over all levels. OpenTURNS omits the first level.
    step = reached / np.append(1.0, reached[:-1])
    # The correlation is NaN if the step is 1, which has no variance.
    correlation = np.nan_to_num(np.array(algorithm.getGammaPerStep()))
    cov = math.sqrt(np.sum((1 + correlation) * (1 - step) / (step * per_level)))
    low, high = lognorm.interval(0.95, math.sqrt(math.log1p(cov**2)), scale=probability)
    return RareEvent(probability, float(low), min(1.0, float(high)), cov, runs, levels)


def _margins(g: LimitState, points: np.ndarray) -> np.ndarray:
    # Returns the margins of the points. Raises ValueError if a margin is NaN.
    margins = np.asarray(g(points), float)
    if np.isnan(margins).any():
        raise ValueError(
            f"{int(np.isnan(margins).sum())} margins are NaN; return a number for failed runs, such"
            " as a large margin"
        )
    return margins
