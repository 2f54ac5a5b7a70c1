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
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ravenjax.engines import sources, trace_key, traced_tick
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.kernel import VectorKernel, print_kernel
from ravenjax.ir.time_loop import split
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jax

if TYPE_CHECKING:
    from ravenjax.engines import tracing


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
    traced = _traced(functions, types)
    out = tree.leaves(traced.leaving)
    if any(dtype != np.float32 for dtype in out):
        raise TypeError("what goes out of a tick is float32")
    parts = split(traced.loop, (), (0,))
    kernel = print_kernel(parts, 1, jit.host().features)
    lane_state = (*parts.lane_state, *parts.held_state)
    return StepForm(traced.state, traced.outcomes, len(out), kernel, lane_state, parts.shared_state)


def _traced(functions: StepFunctions, types: StepTypes) -> tracing.TracedLoop:
    # Imports JAX, which a process that finds its code on disk does without.
    from ravenjax.engines import tracing

    number = jax.ShapeDtypeStruct
    inputs, entering = (
        tree.mapped(lambda dtype: number((), dtype), part)
        for part in (types.inputs, types.entering)
    )
    columns = tuple(number((length,), np.float32) for length in types.tables)
    per_tick = (number((), np.int32), entering, columns)
    return tracing.trace_loop(
        functions.begin, functions.step, functions.finish, (inputs,), per_tick
    )
