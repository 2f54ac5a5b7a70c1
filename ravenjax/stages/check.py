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
    """Return the history after this tick. margin: distance to the limit; None: not computed."""
    first = tripped & (check.first_tick < 0)
    nearest = check.margin
    if margin is not None:
        nearest = jnp.where(margin < nearest, margin, nearest)  # a NaN margin is ignored
    return CheckHistory(
        jnp.where(first, tick, check.first_tick), check.count + as_int(tripped), nearest
    )


def outcomes(checks: Mapping[str, CheckHistory]) -> dict[str, Scalar]:
    """Return each check's history as columns of the result table."""
    out: dict[str, Scalar] = {}
    for name, check in checks.items():
        out[f"check_{name}_first_ms"] = check.first_tick
        out[f"check_{name}_count"] = check.count
        out[f"check_{name}_margin"] = check.margin
    return out


def worst_of_arms(arms: list[CheckHistory]) -> CheckHistory:
    """Return one history for the checks of all arms: first trip, sum of trips, smallest margin."""
    count, margin = arms[0].count, arms[0].margin
    for arm in arms[1:]:
        count, margin = count + arm.count, jnp.minimum(margin, arm.margin)
    return CheckHistory(earliest_tick([arm.first_tick for arm in arms]), count, margin)
