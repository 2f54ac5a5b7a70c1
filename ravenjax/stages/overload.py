"""Records the largest tensions of cables as shares of their strength, and the first overload."""

from ravenjax.numbers import Scalar, Setup, Vec, cast_to_real, jnp, record


@record
class OverloadState:
    """The load of all cables of the robot so far."""

    peak: Scalar  # 1, largest tension so far, divided by the strength of its cable
    first: Scalar  # int32, tick in which a cable was first overloaded; -1: never
    cable: Scalar  # int32, index of that cable among all, arm by arm; -1: none


def init(setup: Setup) -> OverloadState:
    """Return the state before the first tick."""
    return OverloadState(cast_to_real(setup, jnp.float32(0.0)), jnp.int32(-1), jnp.int32(-1))


def step(state: OverloadState, loads: tuple[Vec, ...], tick: Scalar) -> OverloadState:
    """Return the state after this tick.

    loads: for each arm, the tension of each cable divided by its strength; above 1: an overload.
    """
    all_loads = [load for arm in loads for load in arm]
    # The index counts the cables of all arms.
    largest, largest_index = all_loads[0], jnp.int32(0)
    for i, load in enumerate(all_loads[1:], start=1):
        largest_index = jnp.where(load > largest, jnp.int32(i), largest_index)
        largest = jnp.maximum(largest, load)
    begins = (largest > 1.0) & (state.first < 0)
    return OverloadState(
        peak=jnp.maximum(state.peak, largest),
        first=jnp.where(begins, tick, state.first),
        cable=jnp.where(begins, largest_index, state.cable),
    )


def outcomes(setup: Setup, state: OverloadState) -> dict[str, Scalar]:
    """Return the outcome columns of a run: a share, a time in ms, and the index of a cable."""
    return {
        "cable_load": state.peak,
        "cable_overload_first_ms": state.first,
        "cable_overload": state.cable,
    }
