"""What the cables of a run carried, as shares of their strength, and which was the first to be
overloaded.
"""

from __future__ import annotations

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import Setup, real
from ravenjax.numbers.vec import Scalar, Vec, record


@record
class OverloadState:
    """What is remembered of every cable of the robot."""

    peak: Scalar  # 1, largest tension so far, by the strength of its cable
    first: Scalar  # int32, tick in which a cable was first overloaded; -1: never
    cable: Scalar  # int32, place of that cable among all, arm by arm; -1: none


def init(setup: Setup) -> OverloadState:
    """Before the first tick."""
    return OverloadState(real(setup, jnp.float32(0.0)), jnp.int32(-1), jnp.int32(-1))


def step(state: OverloadState, loads: tuple[Vec, ...], tick: Scalar) -> OverloadState:
    """After this tick. loads: of each arm's cables, the largest tension in it by their strength;
    above 1: overload.
    """
    every = [load for arm in loads for load in arm]
    largest, place = every[0], jnp.int32(0)
    for i, load in enumerate(every[1:], start=1):
        place = jnp.where(load > largest, jnp.int32(i), place)
        largest = jnp.maximum(largest, load)
    now = (largest > 1.0) & (state.first < 0)
    return OverloadState(
        peak=jnp.maximum(state.peak, largest),
        first=jnp.where(now, tick, state.first),
        cable=jnp.where(now, place, state.cable),
    )


def outcomes(state: OverloadState) -> dict[str, Scalar]:
    """Outcome columns of a run: a share, ms, and the place of a cable among all, arm by arm."""
    return {
        "cable_load": state.peak,
        "cable_overload_first_ms": state.first,
        "cable_overload": state.cable,
    }
