"""What a built-in check leaves behind: when it first tripped, how often, and how close it came."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar, as_int, record


@record
class Check:
    """One check's history over a run."""

    first_tick: Scalar  # int32 tick of the first trip; -1: never
    count: Scalar  # int32 trips
    margin: Scalar  # smallest distance to the limit, in the check's own unit, <= 0 beyond it; inf: none measured


def init(setup: Setup) -> Check:
    """A check that has not looked at anything yet."""
    return Check(np.int32(-1), np.int32(0), np.dtype(setup.precision.real).type(np.inf))


def update(check: Check, tick: Scalar, tripped: Scalar, margin: Scalar | None = None) -> Check:
    """Enter this tick: `tripped` is a truth value, `margin` a distance to the limit (left out where none is cheap)."""
    first = tripped & (check.first_tick < 0)
    nearest = check.margin
    if margin is not None:
        nearest = jnp.where(margin < nearest, margin, nearest)  # a NaN margin says nothing
    return Check(jnp.where(first, tick, check.first_tick), check.count + as_int(tripped), nearest)


def earliest(ticks: list[Scalar]) -> Scalar:
    """The first of some ticks, of which -1 is never."""
    first = ticks[0]
    for t in ticks[1:]:
        first = jnp.where((t >= 0) & ((first < 0) | (t < first)), t, first)
    return first


def worse(arms: list[Check]) -> Check:
    """The checks of all arms as one."""
    count, margin = arms[0].count, arms[0].margin
    for arm in arms[1:]:
        count, margin = count + arm.count, jnp.minimum(margin, arm.margin)
    return Check(earliest([arm.first_tick for arm in arms]), count, margin)
