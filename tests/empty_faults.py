"""Faults that do nothing, for ticks without a campaign."""

import jax.numpy as jnp

from ravenjax.faults.fault import FaultSlot


def no_fault() -> FaultSlot:
    """An empty slot."""
    zero = jnp.int32(0)
    return FaultSlot(
        zero, zero, jnp.float32(0.0), zero, zero, zero, zero, jnp.int32(1), jnp.uint32(0)
    )
