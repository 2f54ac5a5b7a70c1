"""A compiled time loop on one GPU: puts lanes into warps, moves numbers there and back, runs chunk after chunk.

While lanes run through a chunk, their groups' rows for the next one are made.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ravenjax.engines.gpu import device as cuda_device
from ravenjax.engines.gpu.cuda import OPTIONS
from ravenjax.engines.gpu.device import Cubins, Device, DeviceSession
from ravenjax.engines.gpu.kernel import VECTOR, WARP, Form, print_loop
from ravenjax.engines.interface import Progress
from ravenjax.engines.lanes import Lanes
from ravenjax.ir.time_loop import TimeLoop, split

CHUNK = 1000
"""Ticks that one launch takes, at most."""
ROW_WORDS = 2**25
"""Words that the rows of a chunk may take, at most."""


def form_for(device: Device) -> Form:
    """The form measured to be fastest on an H200, with the shared memory that this device has."""
    form = Form()
    words = device.shared_bytes // (form.threads * 4) // VECTOR * VECTOR
    return dataclasses.replace(form, shared_words=min(form.shared_words, words))


@dataclasses.dataclass(frozen=True)
class Places:
    """Which thread computes which lane."""

    lane: np.ndarray  # [threads], the lane that each computes; whole blocks of them
    thread: np.ndarray  # [lanes], where each lane is computed
    group: np.ndarray  # int32 [warps]
    first: np.ndarray  # [groups], a lane of each
    in_order: bool  # thread by thread computes lane by lane


def place(group: np.ndarray, threads: int) -> Places:
    """Whole warps for the lanes of each group, whole blocks of `threads` for all; the last lane of each fills them."""
    if not group.any():
        lanes = np.arange(len(group))
        total = -(-len(group) // threads) * threads
        lane = np.minimum(np.arange(total), len(group) - 1)
        return Places(lane, lanes, np.zeros(total // WARP, np.int32), lanes[:1], True)
    order = np.argsort(group, kind="stable")
    sizes = np.bincount(group)
    warps = -(-sizes // WARP)
    starts = np.concatenate([[0], np.cumsum(warps)[:-1]]) * WARP
    before = np.cumsum(sizes) - sizes
    sorted_group = group[order]
    position = starts[sorted_group] + np.arange(len(group)) - before[sorted_group]
    total = -(-int(warps.sum()) * WARP // threads) * threads
    filled = np.zeros(total, np.int64)
    filled[position] = np.arange(len(group))
    lane = order[np.maximum.accumulate(filled)]
    thread = np.empty(len(group), np.int64)
    thread[order] = position
    return Places(lane, thread, group[lane[::WARP]].astype(np.int32), order[before], False)


def words(column: np.ndarray) -> np.ndarray:
    """A column as 32-bit words."""
    return column.astype(np.uint32) if column.dtype == bool else np.ascontiguousarray(column).view(np.uint32)


def typed(column: np.ndarray, dtype: str) -> np.ndarray:
    """The numbers of a column of words."""
    return column.astype(bool) if dtype == "bool" else column.view(dtype)


class CudaCode:
    """`loop` compiled for a device.

    grouped: the first `shared` inputs of a group's lanes, and what enters a tick, are alike. The tick's own number
    always is.
    """

    def __init__(
        self, loop: TimeLoop, shared: int, grouped: bool, device: Device, form: Form, cubins: Cubins | None = None
    ) -> None:
        ticks = range(len(loop.step.inputs) - loop.lane_inputs - loop.states)
        self.grouped, self.device, self.form = grouped, device, form
        parts = split(loop, range(shared) if grouped else (), ticks if grouped else ticks[:1])
        self.source = print_loop(parts, form, grouped)
        cubin = cuda_device.compile(self.source.text, device.architecture, OPTIONS, cubins)
        module = cuda_device.DeviceModule(device, cubin)
        self.shared_begin, self.shared_run = module.function("shared_begin"), module.function("shared_run")
        self.lane_begin, self.lane_finish = module.function("lane_begin"), module.function("lane_finish")
        self.lane_run = module.function("lane_run", self.source.shared_bytes)

    def run(self, lanes: Lanes, places: Places, ticks: int, progress: Progress | None = None) -> list[np.ndarray]:
        """Run lanes from the beginning; their results, each [lanes]."""
        with DeviceSession(self.device) as session:
            return _Run(self, session, lanes, places, ticks).results(progress)


class _Run:
    """One call of `CudaCode.run`."""

    def __init__(self, code: CudaCode, session: DeviceSession, lanes: Lanes, places: Places, ticks: int) -> None:
        self.code, self.session, self.lanes, self.places, self.ticks = code, session, lanes, places, ticks
        source = code.source
        self.threads = source.form.threads
        self.total, self.blocks = len(places.lane), len(places.lane) // self.threads
        self.groups = len(places.first)
        self.chunk = min(CHUNK, ticks, max(16, ROW_WORDS // (self.groups * max(source.row, 1))))
        columns = [words(column) for column in lanes.inputs]
        packed = np.empty((len(columns), self.total), np.uint32)
        for row, column in zip(packed, columns, strict=True):
            if places.in_order:
                row[: len(column)], row[len(column) :] = column, column[-1]
            else:
                np.take(column, places.lane, out=row)
        of_groups = np.empty((self.groups, len(columns)), np.uint32)
        for k, column in enumerate(columns):
            of_groups[:, k] = column[places.first]
        self.inputs, self.group_inputs = session.upload(packed), session.upload(of_groups)
        self.tables, self.group = session.upload(words(lanes.tables)), session.upload(places.group.view(np.uint32))
        self.state = session.room(self.blocks * source.state * self.threads)
        self.group_state = session.room(self.groups * source.group_state)
        self.rows = [session.room(self.groups * self.chunk * source.row) for _ in range(2)]
        entering = self.groups if code.grouped else self.total
        self.given = [session.room(entering * self.chunk * source.tick_inputs) for _ in range(2)]
        self.out = session.room(self.total * self.chunk * len(source.outputs)) if lanes.out is not None else None

    def results(self, progress: Progress | None) -> list[np.ndarray]:
        session, code = self.session, self.code
        main, urgent = session.main, session.urgent
        self._by_group(code.shared_begin, urgent, self.group_inputs, self.group_state, self.groups)
        session.launch(code.lane_begin, self.blocks, self.threads, main, self.inputs, self.state, self.total)
        starts = range(0, self.ticks, self.chunk)
        marks = [self._make_rows(0, 0)]
        finished = []
        for k, first in enumerate(starts):
            count = min(self.chunk, self.ticks - first)
            if k + 1 < len(starts):
                if k:
                    session.finish(finished[k - 1])  # it read the buffers that are written next
                marks.append(self._make_rows(k + 1, starts[k + 1]))
            session.wait(main, marks[k])
            buffers = self.tables, self.given[k % 2], self.rows[k % 2], self.group
            session.launch(
                code.lane_run, self.blocks, self.threads, main, self.inputs, self.state, *buffers, self.out,
                self.total, first, count,
            )  # fmt: skip
            finished.append(session.mark(main))
            if self.lanes.out is not None:
                self._take_out(first, count)
            if progress is not None:
                session.finish(finished[k])
                progress(count * len(self.places.thread))
        return self._finish()

    def _by_group(self, function: cuda_device.Function, stream: object, *arguments: object) -> None:
        self.session.launch(function, -(-self.groups // WARP), WARP, stream, *arguments)

    def _make_rows(self, k: int, first: int) -> object:
        """Start the rows of chunk `k`; the point where they are there."""
        count, tick_inputs, rows = min(self.chunk, self.ticks - first), self.given[k % 2], self.rows[k % 2]
        urgent, entering = self.session.urgent, self.lanes.tick_inputs
        if self.code.source.tick_inputs and len(entering):
            here = entering[:, first : first + count] if self.code.grouped else entering[first : first + count]
            self.session.write(tick_inputs, words(np.ascontiguousarray(here)), urgent)
        buffers = self.group_inputs, self.group_state, self.tables, tick_inputs, rows
        self._by_group(self.code.shared_run, urgent, *buffers, self.groups, first, count)
        return self.session.mark(urgent)

    def _take_out(self, first: int, count: int) -> None:
        """Bring what went out in a chunk back into the order of lanes."""
        assert self.lanes.out is not None
        block = np.empty((count, len(self.code.source.outputs), self.total), np.uint32)
        self.session.read(block, self.out, self.session.main)
        self.lanes.out[first : first + count] = block[:, :, self.places.thread]

    def _finish(self) -> list[np.ndarray]:
        session, types = self.session, self.code.source.results
        results = session.room(len(types) * self.total)
        buffers = self.inputs, self.state, self.group_state, self.group, results
        session.launch(self.code.lane_finish, self.blocks, self.threads, session.main, *buffers, self.total)
        block = np.empty((len(types), self.total), np.uint32)
        session.read(block, results, session.main)
        lanes = slice(len(self.places.thread)) if self.places.in_order else self.places.thread
        return [typed(row[lanes], dtype) for row, dtype in zip(block, types, strict=True)]
