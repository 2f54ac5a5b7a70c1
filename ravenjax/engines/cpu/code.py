"""A compiled time loop: runs a group of lanes through some ticks, vector after vector of them."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.kernel import FUNCTIONS, print_kernel
from ravenjax.engines.cpu.memory import BufferLayout
from ravenjax.engines.interface import Progress
from ravenjax.engines.lanes import Lanes
from ravenjax.ir.time_loop import TimeLoop, split

CHUNK = 500
"""Ticks between two looks at the next vector of lanes: a group's rows for so many stay in the second-level cache."""
_POINTER, _LONG, _INT = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int32
_SLOT = 8  # bytes, of the widest number


class VectorCode:
    """`loop` compiled for `width` lanes side by side.

    grouped: the first `shared` inputs of its lanes, and what enters a tick, are alike. The tick's own number always is.
    """

    def __init__(
        self, loop: TimeLoop, shared: int, grouped: bool, width: int, objects: jit.Objects | None = None
    ) -> None:
        ticks = range(len(loop.step.inputs) - loop.lane_inputs - loop.states)
        self.grouped, self.width = grouped, width
        self.outputs = len(loop.step.outputs) - loop.states
        self.split = split(loop, range(shared) if grouped else (), ticks if grouped else ticks[:1])
        self.kernel = print_kernel(self.split, width, jit.host().features)
        self._module = module = jit.compile(self.kernel.text, FUNCTIONS, objects)
        self._call = bound(module)

    def run(self, lanes: Lanes, ticks: int, progress: Progress | None = None) -> list[np.ndarray]:
        """Run one group from the beginning; its results, each [lanes]."""
        kernel, width = self.kernel, self.width
        vectors = len(lanes.inputs[0]) // width if lanes.inputs else 1
        inputs = packed(kernel.inputs, lanes.inputs, vectors)
        group_inputs = packed(kernel.group_inputs, [column[:1] for column in lanes.inputs], 1)
        state, prologue = buffer(vectors, kernel.state.bytes), buffer(vectors, kernel.prologue.bytes)
        group_state, results = buffer(1, kernel.group_state.bytes), buffer(vectors, kernel.results.bytes)
        rows = buffer(min(CHUNK, ticks), kernel.row.bytes)
        tick_inputs, tables = lanes.tick_inputs, lanes.tables.ctypes.data
        stride = tick_inputs.strides[0] if len(tick_inputs) > 1 else 0
        spare = np.empty((1, self.outputs, width * _SLOT), np.uint8)
        out = spare if lanes.out is None else lanes.out
        out_stride = out.strides[0] if len(out) > 1 else 0

        self._call.shared_begin(at(group_inputs), at(group_state))
        for v in range(vectors):
            self._call.lane_begin(at(inputs, v), at(state, v), at(prologue, v))
        for first in range(0, ticks, CHUNK):
            count = min(CHUNK, ticks - first)
            entering = (tick_inputs.ctypes.data + first * stride, stride, tick_inputs.strides[1])
            self._call.shared_run(at(group_inputs), at(group_state), tables, *entering, at(rows), first, count)
            for v in range(vectors):
                mine = at(inputs, v), at(prologue, v), at(state, v), tables
                here = entering[0] + (v * width * tick_inputs.itemsize if tick_inputs.ndim == 3 else 0)
                leaving = out.ctypes.data + first * out_stride + (0 if out is spare else v * width * out.itemsize)
                self._call.lane_run(*mine, here, *entering[1:], at(rows), leaving, out_stride, out.strides[1], count)
            if progress is not None:
                progress(count * vectors * width)
        for v in range(vectors):
            self._call.lane_finish(at(inputs, v), at(state, v), at(group_state), at(results, v))
        return _unpacked(kernel.results, results)


class Functions(NamedTuple):
    """The functions of a loop's kernel, see `kernel`."""

    shared_begin: Any
    shared_run: Any
    lane_begin: Any
    lane_run: Any
    lane_finish: Any


def bound(module: jit.HostModule) -> Functions:
    """They, as ctypes calls them; the module must outlive them."""
    run, outside = [_POINTER] * 4, [_LONG, _LONG, _POINTER]
    return Functions(
        module.function("shared_begin", [_POINTER] * 2),
        module.function("shared_run", [*run, *outside, _INT, _LONG]),
        module.function("lane_begin", [_POINTER] * 3),
        module.function("lane_run", [*run, _POINTER, *outside, _POINTER, _LONG, _LONG, _LONG]),
        module.function("lane_finish", [_POINTER] * 4),
    )


def buffer(rows: int, size: int) -> np.ndarray:
    """Zeroed bytes [rows, size], on a cache line."""
    raw = np.zeros(rows * size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + rows * size].reshape(rows, size)


def at(rows: np.ndarray, row: int = 0) -> int:
    """Address of a row."""
    return rows.ctypes.data + row * rows.strides[0]


def _stored(dtype: str) -> np.dtype:
    return np.dtype(np.int32 if dtype == "bool" else dtype)


def packed(layout: BufferLayout, columns: Sequence[np.ndarray], vectors: int) -> np.ndarray:
    """Columns as the kernel reads them: bytes [vectors, ..]."""
    data = buffer(vectors, layout.bytes)
    for dtype, offset, column in zip(layout.types, layout.offsets, columns, strict=True):
        stored = np.ascontiguousarray(column.reshape(vectors, layout.width).astype(_stored(dtype)))
        data[:, offset : offset + stored.shape[1] * stored.itemsize] = stored.view(np.uint8)
    return data


def _unpacked(layout: BufferLayout, buffer: np.ndarray) -> list[np.ndarray]:
    """Numbers that the kernel wrote, each [lanes]."""
    columns = []
    for dtype, offset in zip(layout.types, layout.offsets, strict=True):
        stored = _stored(dtype)
        part = np.ascontiguousarray(buffer[:, offset : offset + layout.width * stored.itemsize])
        columns.append(part.view(stored).reshape(-1).astype(dtype))
    return columns
