"""Defines the number types in which a tick is written: scalars, vectors and records.

The types that most modules need can be imported from here.
"""

# ruff: noqa: F401

from ravenjax.numbers.lazy import jax, jnp, lax, run_eagerly
from ravenjax.numbers.quantity import describe_fields
from ravenjax.numbers.setup import (
    Precision,
    Setup,
    cast_to_real,
    for_each_arm,
    narrow_numbers,
    per_arm,
    widen_numbers,
)
from ravenjax.numbers.vec import (
    INT32_MIN,
    Scalar,
    Vec,
    as_int,
    cast,
    clamp,
    earliest_tick,
    first_tick,
    if_rarely,
    largest,
    record,
    replace,
    to_int32,
    where,
    wrap16,
)
