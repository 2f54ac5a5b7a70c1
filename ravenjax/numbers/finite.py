"""Finds the first number of a run that is infinite or NaN, and the tick in which it became so."""

import operator
from collections.abc import Iterable, Mapping
from functools import reduce

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, record
from ravenjax.vocabulary.failures import CODES


@record
class FiniteState:
    """The first number of a run that was infinite or NaN."""

    first: Scalar  # int32, first tick in which a number was not finite; -1: never
    signal: Scalar  # int32, code of that number in `failures.CODES`; -1: none


def init() -> FiniteState:
    """Return the state before the first tick, when every number is finite."""
    return FiniteState(jnp.int32(-1), jnp.int32(-1))


def step(state: FiniteState, watched: Mapping[str, Iterable[Scalar]], tick: Scalar) -> FiniteState:
    """Return the state after this tick. `watched` maps names of `failures.SIGNALS` to their
    numbers. The sum of the numbers is tested, which is infinite or NaN if one of them is. Only the
    first such tick of a run is recorded, with the first such signal in `watched`.
    """
    signal = jnp.int32(-1)
    # In reverse order, so that the first signal overwrites the others.
    for name, numbers in reversed(list(watched.items())):
        total = reduce(operator.add, numbers)
        # An infinite or NaN total minus itself is NaN.
        signal = jnp.where(total - total == 0.0, signal, CODES[name])
    is_first = (signal >= 0) & (state.first < 0)
    return FiniteState(
        jnp.where(is_first, tick, state.first), jnp.where(is_first, signal, state.signal)
    )


def outcomes(state: FiniteState) -> dict[str, Scalar]:
    """Return the outcome columns: the tick, which the engine converts to ms, in which a number was
    first infinite or NaN, and the code of that number; -1: never.
    """
    return {"failed_ms": state.first, "failed_signal": state.signal}
