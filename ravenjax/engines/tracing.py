"""Traces the tick of one robot through JAX: beginning, step and end as straight-line programs.

No array is made, so that JAX looks for no device.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines.interface import Block, TickProgram
from ravenjax.engines.tick_functions import TickFunctions
from ravenjax.engines.traced_tick import TracedTick
from ravenjax.errors import UserError
from ravenjax.ir import lowering
from ravenjax.ir.builder import contract
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.setup import Setup


def x64(setup: Setup) -> contextlib.AbstractContextManager[Any]:
    """JAX with 64-bit numbers where the setup has any, and without where it has none."""
    return jax.enable_x64(setup.precision.needs_x64)


@contextlib.contextmanager
def leaks_refused() -> Iterator[None]:
    """Turn JAX's error about a number that outlived its trace into a UserError with its line."""
    try:
        yield
    except jax.errors.UnexpectedTracerError as error:
        created = re.search(r"created on line (\S+?:\d+)", str(error))
        place = created[1] if created else "a detector, check, controller or operator"
        raise UserError(
            f"{place}: uses a number of jnp that it kept from another call, in a global or a"
            " cache; keep plain numbers, or what init gives"
        ) from error


def trace(
    program: TickProgram, block: Block, motion: Sequence[Any], origin: lowering.Origin | None = None
) -> TracedTick:
    """See `traced.trace`."""
    functions, number = TickFunctions(program), jax.ShapeDtypeStruct
    real = np.dtype(program.setup.precision.real)
    lane = tree.mapped(lambda dtype: number((), dtype), tuple(functions.lane_types(block)))
    of_tick = (
        number((), np.int32),
        [number((), real)] * functions.series,
        tuple(number(column.shape, column.dtype) for column in motion),
    )
    with x64(program.setup):
        traced = trace_loop(
            functions.begin, functions.step, functions.finish, lane, of_tick, origin
        )
    signals = traced.leaving[1]
    return TracedTick(traced.loop, traced.outcomes, functions.series, signals)


class TracedLoop(NamedTuple):
    """A loop, and the dtypes of what it remembers and of what leaves a tick, in their structure."""

    loop: TimeLoop
    state: Any
    leaving: tuple[Any, ...]
    outcomes: tuple[str, ...]


def trace_loop(
    begin: Callable[..., Any],
    step: Callable[..., tuple[Any, ...]],
    finish: Callable[..., dict[str, Any]],
    lane: tuple[Any, ...],
    entering: tuple[Any, ...],
    origin: lowering.Origin | None = None,
) -> TracedLoop:
    """Trace `begin(*lane)`, `step(*lane, state, *entering)` and `finish(*lane, state)`.

    begin returns the state, step the new state and whatever leaves a tick, finish named numbers.
    lane, entering: shapes. origin: as for `lowering.lower`.
    """
    with leaks_refused():
        first, state = jax.make_jaxpr(begin, return_shape=True)(*lane)
        middle, (_, *leaving) = jax.make_jaxpr(step, return_shape=True)(*lane, state, *entering)
        last, outcomes = jax.make_jaxpr(finish, return_shape=True)(*lane, state)
    programs = [contract(lowering.lower(jaxpr, origin)) for jaxpr in (first, middle, last)]
    state, leaving = tree.mapped(lambda leaf: np.dtype(leaf.dtype), (state, tuple(leaving)))
    return TracedLoop(TimeLoop(*programs), state, leaving, tuple(sorted(outcomes)))
