"""The lanes of a group on their way through the ticks: their buffers, and what advances them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.engines.cpu.calls import CallList
from ravenjax.engines.cpu.kernel import VectorKernel
from ravenjax.engines.cpu.memory import BufferLayout, buffer
from ravenjax.engines.cpu.target import Workspace
from ravenjax.engines.lanes import Lanes

_SLOT = 8  # bytes, of the widest number


class LaneGroup:
    """Vectors of lanes before their first tick, and what they share; rows of some ticks at a time.

    Ticks count from the beginning of a run, whichever of them is the first here. What is to be done
    is written down, and done by `go`.
    """

    def __init__(
        self,
        kernel: VectorKernel,
        space: Workspace,
        lanes: Lanes,
        vectors: int,
        rows: int,
        results: int,
    ) -> None:
        """rows, results: how many there is room for at a time. What was written is there once
        `space` is closed.
        """
        self._calls, self._lanes, self._width = CallList(space), lanes, kernel.inputs.width
        self._layout = kernel.results
        self._inputs = space.reads(packed(kernel.inputs, lanes.inputs, vectors))
        self._group_inputs = space.reads(
            packed(kernel.group_inputs, [column[:1] for column in lanes.inputs], 1)
        )
        self.state, self._prologue = (
            space.buffer(vectors, one.bytes) for one in (kernel.state, kernel.prologue)
        )
        self.group_state, self.results = (
            space.buffer(count, one.bytes)
            for count, one in ((1, kernel.group_state), (results, kernel.results))
        )
        self._rows, self._row_tick = space.buffer(rows, kernel.row.bytes), 0
        nowhere = space.buffer(1, kernel.outputs * self._width * _SLOT).reshape(
            1, kernel.outputs, -1
        )
        self._out = nowhere if lanes.out is None else space.writes(lanes.out)
        self._read = (
            space.reads(lanes.tick_inputs),
            space.reads(lanes.tables),
        )  # they live as long as this
        self._tables, self._shared = self._read[1].ctypes.data, at(self.group_state)
        mine = at(self._inputs), at(self._prologue), at(self.state)
        sizes = self._inputs.shape[1], self._prologue.shape[1], self.state.shape[1]
        self._of_vector = [
            tuple(a + v * n for a, n in zip(mine, sizes, strict=True)) for v in range(vectors)
        ]
        self._entering_at, self._row_at = self._read[0].ctypes.data, at(self._rows)
        self._leaving_at, self._results_at = self._out.ctypes.data, at(self.results)
        self._calls.add("shared_begin", at(self._group_inputs), self._shared)
        for inputs, prologue, state in self._of_vector:
            self._calls.add("lane_begin", inputs, state, prologue)

    def go(self) -> None:
        """Do what was written down since the last time."""
        self._calls.make()

    def turn(self, tick: int) -> None:
        """Rows that are made from now on begin with that of `tick`."""
        self._row_tick = tick

    def share(self, first: int, until: int, after: int | None = None) -> None:
        """Make the rows of these ticks, for which there must be room; copy the group's state to
        address `after`.
        """
        row = self._row_at + (first - self._row_tick) * self._rows.shape[1]
        entering = self._entering(first)
        self._calls.add(
            "shared_run",
            at(self._group_inputs),
            self._shared,
            self._tables,
            *entering,
            row,
            first,
            until - first,
        )
        if after is not None and self.group_state.size:
            self._calls.add("copy_bytes", after, self._shared, self.group_state.size)

    def advance(self, v: int, first: int, until: int) -> None:
        """Run vector `v` through these ticks, whose rows are there."""
        lanes, out, aside = self._lanes, self._out, v * self._width
        entering, stride, step = self._entering(first)
        if lanes.tick_inputs.ndim == 3:
            entering += aside * lanes.tick_inputs.itemsize
        stays = len(out) == 1
        leaving = self._leaving_at + (0 if stays else (first - lanes.first) * out.strides[0])
        leaving += 0 if lanes.out is None else aside * out.itemsize
        inputs, prologue, state = self._of_vector[v]
        row = self._row_at + (first - self._row_tick) * self._rows.shape[1]
        strides = 0 if stays else out.strides[0], out.strides[1]
        mine = inputs, prologue, state, self._tables
        self._calls.add(
            "lane_run", *mine, entering, stride, step, row, leaving, *strides, until - first
        )

    def finish(self, v: int, row: int, group_state: int | None = None) -> None:
        """Write the results that vector `v` has now to a row of `results`; group_state: address,
        if not the present.
        """
        inputs, _, state = self._of_vector[v]
        shared = self._shared if group_state is None else group_state
        self._calls.add(
            "lane_finish", inputs, state, shared, self._results_at + row * self.results.shape[1]
        )

    def columns(self) -> list[np.ndarray]:
        """The results, each [rows * width]."""
        return unpacked(self._layout, self.results)

    def _entering(self, tick: int) -> tuple[int, int, int]:
        """Where what enters a tick stands, bytes to that of the next one, and to the next
        number.
        """
        series = self._read[0]
        stride = series.strides[0] if len(series) > 1 else 0
        return self._entering_at + (tick - self._lanes.first) * stride, stride, series.strides[1]


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


def unpacked(layout: BufferLayout, buffer: np.ndarray) -> list[np.ndarray]:
    """Numbers that the kernel wrote, each [lanes]."""
    columns = []
    for dtype, offset in zip(layout.types, layout.offsets, strict=True):
        stored = _stored(dtype)
        part = np.ascontiguousarray(buffer[:, offset : offset + layout.width * stored.itemsize])
        columns.append(part.view(stored).reshape(-1).astype(dtype))
    return columns
