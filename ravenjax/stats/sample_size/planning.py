"""Plans how many runs, or hours of fault-free motion, a wanted precision needs. `sequential`
decides when to stop.
"""

import math
from typing import NamedTuple

from ravenjax.stats.intervals import alpha_of, rates_with_intervals


def hours_to_bound(per_hour: float, count: int = 0, confidence: float = 0.95) -> float:
    """Return the hours in which `count` alarms show that there are at most `per_hour` alarms per
    hour.

    In these hours the upper end of the exact interval (`false_alarms.alarm_rate`) is per_hour.
    Without an alarm it is 3.69 / per_hour at 95 %.
    """
    from scipy.stats import chi2

    # Twice the Poisson mean that has a chance of alpha / 2 to show at most `count` (Garwood 1936).
    return float(chi2.isf(alpha_of(confidence) / 2, 2 * (count + 1))) / 2 / per_hour


class MoreRuns(NamedTuple):
    """Further runs to a wanted half-width.

    `expected`: if the rate stays as observed. `safe`: if the rate moves within its interval towards
    one half, where a rate is hardest to estimate.
    """

    expected: int
    safe: int


def more_runs(k: int, n: int, half_width: float, confidence: float = 0.95) -> MoreRuns:
    """Return further runs until the Wilson interval of a rate observed as k of n is +- half_width
    (fraction) or narrower; n > 0.
    """
    (rate,) = rates_with_intervals(k, n, confidence)
    worst = min(max(0.5, rate.low), rate.high)
    return MoreRuns(
        *(max(0, _wilson_runs(p, half_width, confidence) - rate.n) for p in (rate.value, worst))
    )


def _wilson_runs(rate: float, half_width: float, confidence: float) -> int:
    """Return the fewest runs with which a Wilson interval around `rate` is +- half_width or
    narrower.

    With z the normal quantile, the interval's half-width is z sqrt(p (1 - p) / n + (z / 2 n)^2) /
    (1 + z^2 / n), which falls with n. Setting it to half_width gives a quadratic equation in n with
    one positive root.
    """
    from scipy.special import ndtri

    z, square = float(ndtri(1 - alpha_of(confidence) / 2)), half_width**2
    excess = rate * (1 - rate) - 2 * square
    root = z**2 * (excess + math.sqrt(excess**2 + square * (1 - 4 * square))) / (2 * square)
    # An excess that is only floating-point rounding does not add a run.
    return max(1, math.ceil(root * (1 - 1e-9)))
