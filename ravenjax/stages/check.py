"""Records for each built-in check the first trip, the number of trips, and the smallest margin."""

from collections.abc import Mapping

import numpy as np

from ravenjax.numbers import Scalar, Setup, as_int, earliest_tick, jnp, record


@record
class CheckHistory:
    """One check's history over a run."""

    first_tick: Scalar  # int32 tick of the first trip; -1: never
    count: Scalar  # int32 trips
    margin: Scalar  # smallest distance to the limit, <= 0 beyond it; inf: never measured


def init(setup: Setup) -> CheckHistory:
    """Return the history of a check before the first tick."""
    return CheckHistory(np.int32(-1), np.int32(0), np.dtype(setup.precision.real).type(np.inf))


def update_check(
    check: CheckHistory, tick: Scalar, tripped: Scalar, margin: Scalar | None = None
) -> CheckHistory:
    """Return the history of a check after this tick. tripped: bool, the check tripped in this tick.
    margin: distance to the limit; None: unknown.
    """
    is_first = tripped & (check.first_tick < 0)
    smallest_margin = check.margin
    if margin is not None:
        # A comparison with NaN is false, so a margin that is NaN is ignored.
        smallest_margin = jnp.where(margin < smallest_margin, margin, smallest_margin)
    first_tick = jnp.where(is_first, tick, check.first_tick)
    return CheckHistory(first_tick, check.count + as_int(tripped), smallest_margin)


def outcomes(checks: Mapping[str, CheckHistory]) -> dict[str, Scalar]:
    """Return the outcome columns of all checks: first trip (ms), number of trips, and margin."""
    columns = {}
    for name, check in checks.items():
        columns[f"check_{name}_first_ms"] = check.first_tick
        columns[f"check_{name}_count"] = check.count
        columns[f"check_{name}_margin"] = check.margin
    return columns


def worst_of_arms(arms: list[CheckHistory]) -> CheckHistory:
    """Return one history for the checks of all arms: first trip, sum of trips, smallest margin."""
    count, margin = arms[0].count, arms[0].margin
    for arm in arms[1:]:
        count, margin = count + arm.count, jnp.minimum(margin, arm.margin)
    return CheckHistory(earliest_tick([arm.first_tick for arm in arms]), count, margin)
