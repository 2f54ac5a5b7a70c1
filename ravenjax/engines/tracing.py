"""Traces the tick of one robot for a program: beginning, step and end as straight-line programs.

The only use that engines which print code have for JAX. No array is made, so that JAX looks for no device.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.engines.interface import Block, TickProgram
from ravenjax.engines.traced_tick import TracedTick
from ravenjax.ir import lowering
from ravenjax.ir.builder import contract
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import where


def x64(setup: Setup) -> contextlib.AbstractContextManager[Any]:
    """JAX with 64-bit numbers where the setup has any, and without where it has none."""
    return jax.enable_x64(setup.precision.needs_x64)


def frozen(now: Any, own_end: tuple[Any, ...], new: Any, state: Any) -> Any:
    """The state after tick `now`: as it was where the lane has ended."""
    return where(now < own_end[0], new, state) if own_end else new


def trace(
    program: TickProgram, block: Block, motion: Sequence[Any], origin: lowering.Origin | None = None
) -> TracedTick:
    """See `traced.trace`."""
    loop, setup, number = program.loop, program.setup, jax.ShapeDtypeStruct
    real = np.dtype(setup.precision.real)
    varied = [number((), np.asarray(block.varied[path]).dtype) for path in program.varied]
    faults = tree.mapped(lambda leaf: number((), np.asarray(leaf).dtype), block.faults)
    end = (number((), np.int32),) if program.ends else ()
    length = loop.series_length(setup)

    def begin(varied: Any, faults: Any, end: Any) -> Any:
        return loop.init(setup, program.params_of(varied))

    def step(varied: Any, faults: Any, end: Any, state: Any, now: Any, reference: Any, motion: Any) -> Any:
        params = program.params_of(varied)
        new, series, signals = loop.advance(setup, params, faults, state, now, motion, reference)
        return frozen(now, end, new, state), series, signals

    def finish(varied: Any, faults: Any, end: Any, state: Any) -> Any:
        return loop.outcomes(setup, program.params_of(varied), state)

    with x64(setup):
        first, state = jax.make_jaxpr(begin, return_shape=True)(varied, faults, end)
        of_tick = (number((), jnp.int32), [number((), real)] * length, tuple(number(c.shape, c.dtype) for c in motion))
        middle, (_, _, signals) = jax.make_jaxpr(step, return_shape=True)(varied, faults, end, state, *of_tick)
        last, outcomes = jax.make_jaxpr(finish, return_shape=True)(varied, faults, end, state)
    programs = [contract(lowering.lower(jaxpr, origin)) for jaxpr in (first, middle, last)]
    dtypes = tree.mapped(lambda leaf: np.dtype(leaf.dtype), signals)
    return TracedTick(TimeLoop(*programs), tuple(sorted(outcomes)), length, dtypes)
