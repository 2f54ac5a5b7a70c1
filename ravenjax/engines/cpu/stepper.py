"""One robot, compiled, advanced a tick at a time by whoever holds the clock.

The same printed code as engine `simd`, one lane wide: the same bits. State, inputs and tables are
plain memory between two ticks, so that inputs may change (a fault is armed), the state may be
copied (a robot to try things on), and the operator's motion may be written row by row as it
happens.
"""

from __future__ import annotations

import ctypes
import functools
import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.engines.cpu import jit, step_code
from ravenjax.engines.cpu.group import at, packed
from ravenjax.engines.cpu.kernel import FUNCTIONS
from ravenjax.engines.cpu.memory import BufferLayout, buffer
from ravenjax.numbers import lazy, tree

_FORMATS = {"float32": "f", "float64": "d", "int32": "i", "uint32": "I", "bool": "i"}
_NUMBER = 4  # bytes of a number that enters or leaves a tick
_POINTERS = ("inputs", "group", "tables", "entering", "row", "held", "state")
"""Of a stepper's buffers, as `one_tick` finds them one after the other."""


def _one_tick() -> str:
    """Both runs of one tick in a single call: calls from Python cost as much as either of them."""
    loads = (
        f"  %at_{name} = getelementptr ptr, ptr %buffers, i64 {k}\n  %{name} = load ptr, ptr"
        f" %at_{name}\n"
        for k, name in enumerate(_POINTERS)
    )
    entering = f"ptr %entering, i64 0, i64 {_NUMBER}, ptr %row"
    return (
        f"define void @one_tick(ptr %buffers, i32 %tick, ptr %out) {{\n{''.join(loads)}  call void"
        f" @shared_run(ptr %inputs, ptr %group, ptr %tables, {entering}, i32 %tick, i64 1)\n  call"
        f" void @lane_run(ptr %inputs, ptr %held, ptr %state, ptr %tables, {entering}, ptr %out,"
        f" i64 0, i64 {_NUMBER}, i64 1)\n  ret void\n}}\n"
    )


class StepCode:
    """A traced and compiled loop: `begin`, `step` and `finish` as described in `compile`; shared
    by its `Stepper`s.
    """

    def __init__(
        self,
        begin: Callable[[Any], Any],
        step: Callable[[Any, Any, Any, Any, Any], tuple[Any, Sequence[Any]]],
        finish: Callable[[Any, Any], dict[str, Any]],
        inputs: Any,
        entering: Any,
        tables: Sequence[int],
        objects: jit.Objects | None = None,
        key: str = "",
    ) -> None:
        """begin(inputs) -> state; step(inputs, state, tick, entering, tables) -> (state, float32
        numbers that go out); finish(inputs, state) -> named numbers. `inputs` and `entering`:
        records of numbers with the right types, of 32 bits each; `tables`: lengths of float32
        tables. objects, key: where code is kept, and under what, see `step_code.form`."""
        kinds, entering_kinds = (
            tree.mapped(lambda x: np.asarray(x).dtype, numbers) for numbers in (inputs, entering)
        )
        self.tables = tuple(tables)
        types = step_code.StepTypes(kinds, entering_kinds, self.tables)
        form = step_code.form(step_code.StepFunctions(begin, step, finish), types, objects, key)
        self.input_types: list[np.dtype] = tree.leaves(kinds)
        self.entering_types: list[np.dtype] = tree.leaves(entering_kinds)
        self.state, self.names, self.outputs, self.kernel = (
            form.state,
            form.names,
            form.outputs,
            form.kernel,
        )
        self._lane_state, self._shared_state = form.lane_state, form.shared_state
        self.results = struct.Struct(
            "=" + "".join(_FORMATS[dtype] for dtype in self.kernel.results.types)
        )
        text = f"{self.kernel.text}\n{_one_tick()}"
        self._module = module = jit.compile(text, (*FUNCTIONS, "one_tick"), objects)
        self.shared_begin = module.function("shared_begin", [ctypes.c_void_p] * 2)
        self.lane_begin = module.function("lane_begin", [ctypes.c_void_p] * 3)
        self.lane_finish = module.function("lane_finish", [ctypes.c_void_p] * 4)
        self.one_tick = module.function(
            "one_tick", [ctypes.c_void_p, ctypes.c_int32, ctypes.c_void_p]
        )

    @functools.cached_property
    def state_places(self) -> dict[int, tuple[bool, int, int]]:
        """Of each number of the state that is kept, by its place among the state's leaves: whether
        it stands in the group's buffer, its offset there and its bytes."""
        places = {}
        for group, numbers, layout in (
            (False, self._lane_state, self.kernel.state),
            (True, self._shared_state, self.kernel.group_state),
        ):
            ends = (*layout.offsets[1:], layout.bytes)[: len(layout.offsets)]  # of no numbers: none
            for k, start, end in zip(numbers, layout.offsets, ends, strict=True):
                places[k] = (group, start, end - start)
        return places


class Stepper:
    """One robot of a `StepCode`.

    `inputs`, `entering` and `tables` are arrays to write to: `inputs[k][0] = x` changes an input,
    to be followed by `inputs_changed()`; `entering[k][0] = x` what enters the next tick;
    `tables[k]` a table, which steppers may share.
    """

    def __init__(self, code: StepCode, inputs: Any, tables: np.ndarray | None = None) -> None:
        """inputs: as in `StepCode`. tables: float32, all columns one after the other; zeros if
        left out.
        """
        self.code = code
        kernel = code.kernel
        leaves = [
            np.asarray(x, dtype).reshape(1)
            for x, dtype in zip(tree.leaves(inputs), code.input_types, strict=True)
        ]
        self._inputs = packed(kernel.inputs, leaves, 1)
        self.inputs = _views(self._inputs[0], kernel.inputs, code.input_types)
        self._state, self._held = buffer(1, kernel.state.bytes), buffer(1, kernel.prologue.bytes)
        self._group, self._row = buffer(1, kernel.group_state.bytes), buffer(1, kernel.row.bytes)
        self._results = buffer(1, kernel.results.bytes)
        self._entering = buffer(1, max(_NUMBER * len(code.entering_types), _NUMBER))
        self.entering = [
            self._entering[0, _NUMBER * k : _NUMBER * (k + 1)].view(
                np.int32 if dtype.kind == "b" else dtype
            )
            for k, dtype in enumerate(code.entering_types)
        ]
        self.flat = (
            np.full(sum(code.tables), 0.0, np.float32) if tables is None else tables
        )  # there before it is used
        ends = np.cumsum(code.tables)
        self.tables = [
            self.flat[end - length : end] for end, length in zip(ends, code.tables, strict=True)
        ]
        pointers = (  # in the order of _POINTERS
            at(self._inputs),
            at(self._group),
            self.flat.ctypes.data,
            at(self._entering),
            at(self._row),
            at(self._held),
            at(self._state),
        )
        self._pointers = np.array(pointers, np.uintp)
        self._buffers = self._pointers.ctypes.data
        self._finish = (at(self._inputs), at(self._state), at(self._group), at(self._results))
        self.begin()

    def begin(self) -> None:
        """Back to before the first tick."""
        self.code.shared_begin(at(self._inputs), at(self._group))
        self.code.lane_begin(at(self._inputs), at(self._state), at(self._held))

    def step(self, tick: int, out: int) -> None:
        """One tick; writes what goes out as float32 numbers to address `out`."""
        self.code.one_tick(self._buffers, tick, out)

    def inputs_changed(self) -> None:
        """Take over changed inputs; the state stays."""
        before = self._state.copy()
        self.code.lane_begin(at(self._inputs), at(self._state), at(self._held))
        self._state[:] = before

    def outcomes(self) -> dict[str, Any]:
        """What became of it so far; a truth value is 0 or -1."""
        self.code.lane_finish(*self._finish)
        return dict(
            zip(self.code.names, self.code.results.unpack_from(self._results.data), strict=True)
        )

    def snapshot(self) -> tuple[np.ndarray, np.ndarray]:
        """A copy of its state, for `restore` of any stepper of the same code."""
        return self._state.copy(), self._group.copy()

    def restore(self, snapshot: tuple[np.ndarray, np.ndarray]) -> None:
        """Take over a state."""
        self._state[:], self._group[:] = snapshot

    def change(self, function: Callable[[Any], Any]) -> None:
        """Put `function` of the state in its place: a record of numbers in, the same with some of
        them replaced out.

        A number that no tick reads is not kept: it is NaN, and replacing it does nothing.
        """
        leaves = tree.leaves(self.code.state)
        places = self.code.state_places
        numbers = {
            k: self._number(places[k], dtype) for k, dtype in enumerate(leaves) if k in places
        }
        before = [numbers[k][0].item() if k in numbers else math.nan for k in range(len(leaves))]
        with lazy.at_once():
            after = tree.leaves(function(tree.filled(self.code.state, before)))
        for k, place in numbers.items():
            if after[k] is not before[k]:
                place[0] = after[k]

    def _number(self, place: tuple[bool, int, int], dtype: Any) -> np.ndarray:
        """A one-number array of the state."""
        group, start, size = place
        stored = np.dtype(np.int32 if np.dtype(dtype).kind == "b" else dtype)
        return (self._group if group else self._state)[0, start : start + size].view(stored)

    def restore_leaves(
        self, snapshot: tuple[np.ndarray, np.ndarray], leaves: Sequence[int]
    ) -> None:
        """Take over some numbers of a state, by their places among the leaves of its record."""
        places = self.code.state_places
        for k in leaves:
            if k in places:
                group, start, size = places[k]
                target = self._group if group else self._state
                target[0, start : start + size] = snapshot[int(group)][0, start : start + size]


def _views(buffer: np.ndarray, layout: BufferLayout, types: Sequence[np.dtype]) -> list[np.ndarray]:
    """A one-number array for each number of a buffer of width 1."""
    stored = [np.dtype(np.int32 if dtype.kind == "b" else dtype) for dtype in types]
    return [
        buffer[offset : offset + dtype.itemsize].view(dtype)
        for offset, dtype in zip(layout.offsets, stored, strict=True)
    ]
