"""Which number of a run was the first that is infinite or no number (NaN), and when."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from functools import reduce

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, record
from ravenjax.vocabulary.failures import CODES


@record
class FiniteState:
    """What is remembered of the numbers of a run."""

    first: Scalar  # int32, first tick in which one was not finite; -1: never
    signal: Scalar  # int32, which: `failures.CODES`; -1: none


def init() -> FiniteState:
    """Every number is finite."""
    return FiniteState(jnp.int32(-1), jnp.int32(-1))


def step(state: FiniteState, watched: Mapping[str, Iterable[Scalar]], tick: Scalar) -> FiniteState:
    """After this tick. watched: numbers by what they are, a name of `failures.SIGNALS`; their sum
    is looked at.

    Only the first time counts. Of several that are not finite in one tick the one that stands first
    is named.
    """
    signal = jnp.int32(-1)
    for name, numbers in reversed(list(watched.items())):
        total = reduce(operator.add, numbers)
        signal = jnp.where(total - total == 0.0, signal, CODES[name])
    now = (signal >= 0) & (state.first < 0)
    return FiniteState(jnp.where(now, tick, state.first), jnp.where(now, signal, state.signal))


def outcomes(state: FiniteState) -> dict[str, Scalar]:
    """Outcomes of a run: ms and code of the first number that was not finite, -1 where there was
    none.
    """
    return {"failed_ms": state.first, "failed_signal": state.signal}
