"""Runs a compiled time loop on one GPU, chunk by chunk of ticks, and copies inputs and results.

Robots (lanes) with the same parameters form a group, and the numbers that are equal in a group are
computed once. While the lanes run one chunk, the GPU computes these numbers for the next chunk.
"""

import dataclasses

import numpy as np

from ravenjax.engines.gpu import device as cuda_device
from ravenjax.engines.gpu.course import EVERY, BlockCourse, Places, plan_course
from ravenjax.engines.gpu.cuda import OPTIONS
from ravenjax.engines.gpu.device import Device, DeviceSession
from ravenjax.engines.gpu.kernel import VECTOR, WARP, Form, KernelSource
from ravenjax.engines.interface import Progress
from ravenjax.engines.lanes import Lanes, Trunk
from ravenjax.engines.trace_key import Objects

CHUNK = 1000
"""Largest number of ticks of a launch. If blocks run at different times, a launch has as many ticks
as fit in memory, because blocks wait for each other at the end of each launch.
"""
ROW_WORDS = 2**25
"""Largest number of words for the rows of a chunk."""


def form_for(device: Device) -> Form:
    """Return the form that was fastest on an H200, limited to this device's shared memory."""
    form = Form()
    words = device.shared_bytes // (form.threads * 4) // VECTOR * VECTOR
    return dataclasses.replace(form, shared_words=min(form.shared_words, words))


def column_words(column: np.ndarray) -> np.ndarray:
    """Return a column as 32-bit words."""
    if column.dtype == bool:
        return column.astype(np.uint32)
    return np.ascontiguousarray(column).view(np.uint32)


def typed_column(column: np.ndarray, dtype: str) -> np.ndarray:
    """Return the numbers of a column of words."""
    return column.astype(bool) if dtype == "bool" else column.view(dtype)


class CudaCode:
    """Generated kernels compiled for a device."""

    def __init__(
        self,
        source: KernelSource,
        grouped: bool,
        device: Device,
        form: Form,
        objects: Objects | None = None,
    ):
        """grouped, form: see `print_loop`."""
        self.source, self.grouped, self.device, self.form = source, grouped, device, form
        cubin = cuda_device.compile_cubin(source.text, device.architecture, OPTIONS, objects)
        module = cuda_device.DeviceModule(device, cubin)
        self.lane_run = module.function("lane_run", self.source.shared_bytes)
        names = ("shared_begin", "shared_run", "group_snapshot")
        names += ("lane_begin", "lane_branch", "lane_finish", "lane_snapshot")
        self.functions = {name: module.function(name) for name in names}

    def run_course(
        self, lanes: Lanes, places: Places, course: BlockCourse, progress: Progress | None = None
    ) -> list[np.ndarray]:
        """Run lanes through the ticks of `course`; return their results, each [lanes]."""
        # A launch waits for its slowest block of threads, so blocks that run at different times get
        # a single launch of all ticks. If outputs are kept, or if lanes that are not grouped have
        # their own inputs in each tick, these need too much memory for a single launch.
        one_launch = self.grouped and course.scattered and lanes.out is None
        chunk = course.last - course.first if one_launch else CHUNK
        with DeviceSession(self.device) as session:
            run = _Run(self, session, lanes, places, course, chunk)
            run.run(progress)
            return run.finish()

    def trunk(self, lanes: Lanes, places: Places, last: int) -> Trunk:
        """Return snapshots of a golden run before tick `last`; all lanes are equal to this run."""
        course = plan_course(places, self.form.threads, np.full(len(places.thread), max(last, 1)))
        with DeviceSession(self.device) as session:
            return _Run(self, session, lanes, places, course, EVERY).trunk()


class _Run:
    def __init__(
        self,
        code: CudaCode,
        session: DeviceSession,
        lanes: Lanes,
        places: Places,
        course: BlockCourse,
        chunk: int,
    ):
        """chunk: largest number of ticks of a launch."""
        self.code, self.session, self.lanes = code, session, lanes
        self.places, self.course = places, course
        source = code.source
        self.threads = code.form.threads
        self.total, self.blocks = len(places.lane), len(places.lane) // self.threads
        self.groups = len(places.first)
        ticks = course.last - course.first
        self.chunk = min(chunk, ticks, max(16, ROW_WORDS // (self.groups * max(source.row, 1))))
        columns = [column_words(column) for column in lanes.inputs]
        packed = np.empty((len(columns), self.total), np.uint32)
        packed_groups = np.empty((self.groups, len(columns)), np.uint32)
        for k, column in enumerate(columns):
            np.take(column, places.lane, out=packed[k])
            packed_groups[:, k] = column[places.first]
        self.inputs, self.group_inputs = session.upload(packed), session.upload(packed_groups)
        self.tables = session.upload(column_words(lanes.tables))
        self.group, self.spans, self.ends = (
            session.upload(column.view(np.uint32))
            for column in (places.group, course.spans, course.ends)
        )
        self.saved = session.allocate(self.total * source.saved)
        self.state = session.allocate(self.blocks * source.state * self.threads)
        self.group_state = session.allocate(self.groups * source.group_state)
        self.rows = [session.allocate(self.groups * self.chunk * source.row) for _ in range(2)]
        input_words = (self.groups if code.grouped else self.total) * source.tick_inputs
        # Inputs of ticks, in two buffers: one is written while the lanes read the other.
        self.given = [session.allocate(input_words * self.chunk) for _ in range(2)]
        out_words = self.total * self.chunk * source.outputs
        self.out = None if lanes.out is None else session.allocate(out_words)
        # Device memory for the snapshots of the group and of the lane.
        self.device_snapshots: dict[str, object] = {}

    def trunk(self) -> Trunk:
        """Run lanes that are all the same golden run; return its snapshots before each chunk."""
        source, session = self.code.source, self.session
        count = -(-self.course.last // self.chunk)
        snapshots = Trunk.allocate(self.chunk, count, source.group_state, source.state)
        host = {"group": snapshots.group, "lane": snapshots.lane}
        self.device_snapshots = {what: session.allocate(x.size) for what, x in host.items()}
        self.run(None)
        for what, states in host.items():
            session.read(states, self.device_snapshots[what], session.main)
        return snapshots

    def run(self, progress: Progress | None) -> None:
        """Run lanes through all ticks. During a chunk, the GPU computes the next chunk's rows."""
        session, code, course = self.session, self.code, self.course
        main = session.main
        self._begin()
        # Ticks that a lane does not have to run are reported at once.
        running = course.lane_ticks(self.places, 0, course.last)
        if progress is not None and (idle := course.last * len(self.places.thread) - running):
            progress(idle)
        starts = range(course.first, course.last, self.chunk)
        rows_done = [self._make_rows(0, course.first)]
        lanes_done = []
        for k, first in enumerate(starts):
            count = min(self.chunk, course.last - first)
            if k + 1 < len(starts):
                if k:
                    # Of two buffers, chunk k + 1 overwrites the one that lanes read in chunk k - 1.
                    session.finish(lanes_done[k - 1])
                rows_done.append(self._make_rows(k + 1, starts[k + 1]))
            session.wait(main, rows_done[k])
            self._store_snapshot("lane", code.source.state, main, self.state, k)
            # The arguments are in the order of the parameters of `lane_run` in kernel.cu.j2.
            session.launch(
                code.lane_run,
                *(self.blocks, self.threads, main),
                *(self.inputs, self.state, self.tables, self.given[k % 2], self.rows[k % 2]),
                *(self.group, self.spans, self.ends, self.saved, self.out),
                *(self.total, first, count),
            )
            lanes_done.append(session.mark(main))
            if self.lanes.out is not None:
                self._read_outputs(first, count)
            if progress is not None:
                session.finish(lanes_done[k])
                progress(course.lane_ticks(self.places, first, first + count))

    def _begin(self):
        # Initialises the groups, then the lanes, then the lanes that start from snapshots.
        session, code, course = self.session, self.code, self.course
        # If no block begins in tick 0, groups also start from snapshots.
        if course.group_state is None:
            arguments = self.group_inputs, self.group_state, self.groups
            self._launch_for_groups("shared_begin", *arguments)
        else:
            session.write(self.group_state, course.group_state, session.urgent)
        grid = self.blocks, self.threads, session.main
        session.launch(code.functions["lane_begin"], *grid, self.inputs, self.state, self.total)
        if len(course.snapshots):
            snapshots = session.upload(course.snapshots)
            of_warp = session.upload(course.snapshot_of_warp.view(np.uint32))
            session.launch(code.functions["lane_branch"], *grid, snapshots, of_warp, self.state)

    def _store_snapshot(self, what: str, words: int, stream, state, row: int):
        """Copy the state of the first "group" or "lane" (`what`) to a row of its snapshots, if any
        are made. words: number of 32-bit words of this state.
        """
        if self.device_snapshots and words:
            self.session.launch(
                self.code.functions[f"{what}_snapshot"],
                *(-(-words // WARP), WARP, stream, state, self.device_snapshots[what], row),
            )

    def _launch_for_groups(self, name: str, *arguments: object):
        # Launches a kernel with one thread per group, on the stream of rows.
        grid = -(-self.groups // WARP), WARP, self.session.urgent
        self.session.launch(self.code.functions[name], *grid, *arguments)

    def _make_rows(self, k: int, first: int) -> object:
        """Start computing each group's rows of chunk `k`, on stream `urgent`, beside the lanes.
        first: first tick of the chunk. Chunks use two buffers in turn. Returns a mark that the
        stream reaches after the rows.
        """
        count, buffer = min(self.chunk, self.course.last - first), self.given[k % 2]
        urgent, source = self.session.urgent, self.code.source
        tick_inputs = self.lanes.tick_inputs
        self._store_snapshot("group", source.group_state, urgent, self.group_state, k)
        if source.tick_inputs and len(tick_inputs):
            ticks = slice(first, first + count)
            # The axes are [groups, ticks, numbers] or [ticks, numbers, threads].
            part = tick_inputs[:, ticks] if self.code.grouped else tick_inputs[ticks]
            self.session.write(buffer, column_words(np.ascontiguousarray(part)), urgent)
        buffers = self.group_inputs, self.group_state, self.tables, buffer, self.rows[k % 2]
        self._launch_for_groups("shared_run", *buffers, self.groups, first, count)
        return self.session.mark(urgent)

    def _read_outputs(self, first: int, count: int):
        # Copies the outputs of `count` ticks from the device, for the thread of each lane.
        assert self.lanes.out is not None
        block = np.empty((count, self.code.source.outputs, self.total), np.uint32)
        self.session.read(block, self.out, self.session.main)
        self.lanes.out[first : first + count] = block[:, :, self.places.thread]

    def finish(self) -> list[np.ndarray]:
        """Return the results, each [lanes]."""
        session, types = self.session, self.code.source.results
        results = session.allocate(len(types) * self.total)
        buffers = self.inputs, self.state, self.saved, results
        finish = self.code.functions["lane_finish"]
        session.launch(finish, self.blocks, self.threads, session.main, *buffers, self.total)
        block = np.empty((len(types), self.total), np.uint32)
        session.read(block, results, session.main)
        # Some threads compute no lane, so the result of each lane is taken from its thread.
        return list(map(typed_column, block[:, self.places.thread], types))
