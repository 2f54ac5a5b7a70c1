"""Beginning, tick and end of one robot that is stepped from outside, traced and printed.

What was printed is kept by a key of all that decides it, so that the next process finds it and
neither traces nor prints.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ravenjax.engines import sources, trace_key, traced_tick
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.kernel import VectorKernel, print_kernel
from ravenjax.ir.builder import contract
from ravenjax.ir.time_loop import TimeLoop, split
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jax


@dataclasses.dataclass(frozen=True)
class StepFunctions:
    """What is stepped."""

    begin: Callable[[Any], Any]  # inputs -> state
    step: Callable[[Any, Any, Any, Any, Any], tuple[Any, Sequence[Any]]]
    """inputs, state, tick, entering, tables -> state, float32 numbers that go out"""
    finish: Callable[[Any, Any], dict[str, Any]]  # inputs, state -> named numbers


@dataclasses.dataclass(frozen=True)
class StepTypes:
    """Types of what enters: trees of dtypes, of 32 bits each, and lengths of float32 tables."""

    inputs: Any
    entering: Any
    tables: tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class StepForm:
    """What a step is besides its code."""

    state: Any  # structure of the state, each leaf its dtype
    names: tuple[str, ...]  # of the outcomes
    outputs: int  # numbers that go out of a tick
    kernel: VectorKernel
    lane_state: tuple[int, ...]  # numbers of the state, in the order of `kernel.state`
    shared_state: tuple[int, ...]  # those of `kernel.group_state`


@dataclasses.dataclass(frozen=True)
class _StepText:
    """A `StepForm` as it is kept: the state's structure as JSON."""

    state: str
    names: tuple[str, ...]
    outputs: int
    kernel: VectorKernel
    lane_state: tuple[int, ...]
    shared_state: tuple[int, ...]


def form(
    functions: StepFunctions, types: StepTypes, objects: jit.Objects | None, key: str
) -> StepForm:
    """What `functions` are for these types, as it was kept or made now.

    key: hash of all that decides the functions, besides this package's lower floors; "": nothing is
    kept. Raises TypeError where something else than float32 goes out of a tick.
    """
    if not key or objects is None or not sources.unchanged():
        return _made(functions, types)
    place = _place(types, key)
    if (content := objects.get(place)) is not None:
        with contextlib.suppress(
            zlib.error, ValidationError, ValueError, KeyError
        ):  # of another version: made anew
            text = TypeAdapter(_StepText).validate_json(zlib.decompress(content))
            return StepForm(**{**vars(text), "state": traced_tick.of_json(json.loads(text.state))})
    result = _made(functions, types)
    with contextlib.suppress(TypeError):  # a state that has no form in JSON
        text = _StepText(**{**vars(result), "state": json.dumps(traced_tick.to_json(result.state))})
        objects[place] = zlib.compress(TypeAdapter(_StepText).dump_json(text), 1)
    return result


def _place(types: StepTypes, key: str) -> str:
    """The key of what is kept: types and code, versions, and the CPU, whose instructions are
    printed.
    """
    names = tree.mapped(lambda dtype: np.dtype(dtype).str, (types.inputs, types.entering))
    cpu = tuple(sorted(jit.host().features))
    return trace_key.of(
        "step", key, names, types.tables, cpu, sources.AT_IMPORT, trace_key.versions()
    )


def _made(functions: StepFunctions, types: StepTypes) -> StepForm:
    loop, state, out, names = _traced(functions, types)
    if any(dtype != np.float32 for dtype in out):
        raise TypeError("what goes out of a tick is float32")
    parts = split(loop, (), (0,))
    kernel = print_kernel(parts, 1, jit.host().features)
    return StepForm(
        state, names, len(out), kernel, (*parts.lane_state, *parts.held_state), parts.shared_state
    )


_Traced = tuple[TimeLoop, Any, list[np.dtype], tuple[str, ...]]
"""Loop, structure of the state with its dtypes, dtypes of what goes out, names of the outcomes."""


def _traced(functions: StepFunctions, types: StepTypes) -> _Traced:
    from ravenjax.ir import lowering  # imports JAX

    number = jax.ShapeDtypeStruct
    inputs, entering = (
        tree.mapped(lambda dtype: number((), dtype), part)
        for part in (types.inputs, types.entering)
    )
    columns = tuple(number((length,), np.float32) for length in types.tables)
    first, state = jax.make_jaxpr(functions.begin, return_shape=True)(inputs)
    tick = number((), np.int32)
    middle, (_, out) = jax.make_jaxpr(functions.step, return_shape=True)(
        inputs, state, tick, entering, columns
    )
    last, outcomes = jax.make_jaxpr(functions.finish, return_shape=True)(inputs, state)
    loop = TimeLoop(*(contract(lowering.lower(jaxpr)) for jaxpr in (first, middle, last)))
    structure = tree.mapped(lambda leaf: np.dtype(leaf.dtype), state)
    return (
        loop,
        structure,
        [np.dtype(leaf.dtype) for leaf in tree.leaves(out)],
        tuple(sorted(outcomes)),
    )
