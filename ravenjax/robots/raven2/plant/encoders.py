"""Motor encoders: 4000 counts a turn on every motor (raven2: defines.h).

The motor angle itself is kept as whole counts (int32) plus a fraction of one (within half a count).
An angle near 900 rad in float32 swallows increments below 3e-5 rad a millisecond; a fraction of a
count never does, and the reading is exact.
"""

from __future__ import annotations

import math

from ravenjax.numbers import counter_random
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, as_int, record

COUNTS_PER_RAD = 4000.0 / (2.0 * math.pi)
RAD_PER_COUNT = (2.0 * math.pi) / 4000.0


@record
class Angle:
    """A motor angle, from a reference count."""

    count: Scalar  # whole counts, int32
    fraction: Scalar  # of a count, -0.5 to 0.5


def at_angle(angle: Scalar) -> Angle:
    """An angle (rad) as whole counts and a fraction."""
    counts = angle * COUNTS_PER_RAD
    whole = jnp.floor(counts + 0.5)
    return Angle(count=as_int(whole), fraction=counts - whole)


def advance(angle: Angle, turned: Scalar) -> Angle:
    """The angle after turning by `turned` (rad)."""
    moved = angle.fraction + turned * COUNTS_PER_RAD
    whole = jnp.floor(moved + 0.5)
    return Angle(count=angle.count + as_int(whole), fraction=moved - whole)


def radians(angle: Angle, dtype: str) -> Scalar:
    """The angle in rad; rounded to `dtype` once, no error accumulates."""
    return (angle.count.astype(dtype) + angle.fraction) * RAD_PER_COUNT


def noise_counts(rms_cnt: Scalar, key: Scalar, tick: Scalar, channel: int) -> Scalar:
    """Reading error in whole counts, normal with `rms_cnt`, rounded to the nearest."""
    return as_int(jnp.floor(rms_cnt * counter_random.normal(key, tick, channel) + 0.5))
