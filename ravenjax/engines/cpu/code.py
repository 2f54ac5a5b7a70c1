"""Runs a compiled time loop on the CPU, with several robots side by side in each vector register.

Python collects calls of compiled functions in a list, and one compiled function makes all of these
calls. If a Python thread made each call, the thread would wait for the interpreter's lock every
time. With many threads, waiting would take longer than computing.
"""

import ctypes
import dataclasses
from functools import cached_property

import numpy as np

from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.kernel import ARGUMENTS, CALL_WORDS, FUNCTIONS, VectorKernel
from ravenjax.engines.cpu.memory import aligned_buffer
from ravenjax.engines.interface import Progress
from ravenjax.engines.lanes import Lanes, Trunk, snapshot_spacing

CHUNK = 500
"""Ticks that a vector runs before the next vector, so that rows stay in the second-level cache."""
CALL_TICKS = 2**18
"""Vector ticks of one call of compiled code: tenths of a second, so that progress is reported."""


@dataclasses.dataclass(frozen=True)
class LaneCourse:
    """The tick in which each vector of a group begins, and the tick in which each lane ends."""

    begins: np.ndarray  # int [vectors]: ticks of snapshots of `trunk`; 0: from the beginning
    ends: np.ndarray  # int [lanes]: the first tick that the lane does not run
    trunk: Trunk | None = None  # the golden run that the lanes start from

    @property
    def first(self) -> int:
        """The first tick that any lane runs."""
        return int(self.begins.min())

    @property
    def last(self) -> int:
        """The first tick that no lane runs."""
        return int(self.ends.max())

    @property
    def lane_ticks(self) -> int:
        """Number of ticks that lanes run, summed. The lanes of a vector run until the last ends."""
        ends = self.ends.reshape(len(self.begins), -1)
        return int((ends.max(axis=1) - self.begins).sum()) * ends.shape[1]


class LaneGroup:
    """The memory of a group of lanes: state of each vector, shared state, rows of some ticks. Ticks
    count from the beginning of a run. Methods collect calls, which `run_calls` makes.
    """

    def __init__(self, code: "VectorCode", lanes: Lanes, vectors: int, rows: int, results: int):
        """rows, results: number of rows of ticks, and of rows of results, to allocate."""
        self.lanes, self._make_calls = lanes, code.make_calls
        kernel = self.kernel = code.kernel
        self._calls: list[tuple[int, ...]] = []
        self._inputs = kernel.inputs.pack(lanes.inputs, vectors)
        # The inputs that a group shares are equal in its lanes, so those of the first lane serve.
        self._group_inputs = kernel.group_inputs.pack([column[:1] for column in lanes.inputs], 1)
        self.state = aligned_buffer(vectors, kernel.state.bytes)
        self._prologue = aligned_buffer(vectors, kernel.prologue.bytes)
        self.group_state = aligned_buffer(1, kernel.group_state.bytes)
        self.results = aligned_buffer(results, kernel.results.bytes)
        self._rows = aligned_buffer(rows, kernel.row.bytes)
        self.first_row_tick = 0  # tick of the first of the rows, for later calls
        # Compiled code always writes its outputs. Each tick overwrites those that nobody reads.
        self._unread_outputs = aligned_buffer(kernel.outputs, 8 * kernel.inputs.width)
        self._call("shared_begin", row_address(self._group_inputs), row_address(self.group_state))
        for v in range(vectors):
            buffers = (self._inputs, self.state, self._prologue)
            self._call("lane_begin", *(row_address(buffer, v) for buffer in buffers))

    def _call(self, name: str, *arguments: int):
        # Collects a call of the compiled function `name`: its number, its arguments, then zeros.
        index = list(ARGUMENTS).index(name)
        self._calls.append((index, *arguments, *(0,) * (CALL_WORDS - 1 - len(arguments))))

    def run_calls(self) -> None:
        """Make the calls that were collected since the last `run_calls`."""
        calls = np.array(self._calls, np.int64).reshape(-1, CALL_WORDS)
        self._calls.clear()
        self._make_calls(calls.ctypes.data, len(calls))

    def compute_rows(self, first: int, until: int, copy_to: int | None = None) -> None:
        """Advance the group from tick `first` to before `until`, and write a row for each tick. A
        row has the numbers of the tick that all lanes of the group read. copy_to: address for a
        copy of the group's state at the end; None: no copy.
        """
        state = row_address(self.group_state)
        buffers = row_address(self._group_inputs), state, row_address(self.lanes.tables)
        inputs = self._tick_input_arguments(first, lane=0)
        first_row = row_address(self._rows, first - self.first_row_tick)
        self._call("shared_run", *buffers, *inputs, first_row, first, until - first)
        if copy_to is not None and self.group_state.size:
            self._call("copy_bytes", copy_to, state, self.group_state.size)

    def advance(self, v: int, first: int, until: int) -> None:
        """Run vector `v` from tick `first` to before `until`. Rows of these ticks must exist."""
        # Number of the vector's first lane.
        lane, out = v * self.kernel.inputs.width, self.lanes.out
        # Address of the outputs, and the bytes to the next tick and to the next number.
        if out is None:
            outputs = row_address(self._unread_outputs), 0, self._unread_outputs.strides[0]
        else:
            address = row_address(out, first - self.lanes.first) + lane * out.itemsize
            outputs = (address, *out.strides[:2])
        vector = (row_address(buffer, v) for buffer in (self._inputs, self._prologue, self.state))
        tables, inputs = row_address(self.lanes.tables), self._tick_input_arguments(first, lane)
        row = row_address(self._rows, first - self.first_row_tick)
        # The arguments are in the order of the parameters of `lane_run` in llvm.toml.
        self._call("lane_run", *vector, tables, *inputs, row, *outputs, until - first)

    def _tick_input_arguments(self, tick: int, lane: int):
        """Return the address of a tick's inputs from `lane` on, bytes per tick and per number."""
        numbers = self.lanes.tick_inputs
        # An array of one tick serves all ticks.
        tick_bytes = numbers.strides[0] if len(numbers) > 1 else 0
        start = numbers.ctypes.data + (tick - self.lanes.first) * tick_bytes
        # Without an axis of lanes, all lanes read the same numbers.
        if numbers.ndim == 3:
            start += lane * numbers.itemsize
        return start, tick_bytes, numbers.strides[1]

    def finish(self, v: int, row: int, group_state: int | None = None) -> None:
        """Write the results of vector `v` to a row of `results`. group_state: address of a copy of
        the group's state at the vector's end; None: the present state.
        """
        shared = row_address(self.group_state) if group_state is None else group_state
        lane_rows = row_address(self._inputs, v), row_address(self.state, v)
        self._call("lane_finish", *lane_rows, shared, row_address(self.results, row))


def row_address(rows: np.ndarray, row: int = 0) -> int:
    """Return the memory address of a row."""
    return rows.ctypes.data + row * rows.strides[0]


class VectorCode:
    """A compiled kernel."""

    def __init__(self, kernel: VectorKernel, objects: jit.Objects | None = None):
        self.kernel, self.width = kernel, kernel.inputs.width
        self._module = jit.compile_functions(kernel.text, FUNCTIONS, objects)
        self.make_calls = self._module.function("make_calls", [ctypes.c_void_p, ctypes.c_int64])

    def run_course(
        self, lanes: Lanes, course: LaneCourse, progress: Progress | None = None
    ) -> list[np.ndarray]:
        """Run one group through its ticks; return the results at each lane's end, each [lanes]."""
        vectors = len(course.begins)
        lane_ends = np.stack([np.repeat(np.arange(vectors), self.width), course.ends], axis=1)
        # Lanes of a vector that end in the same tick share one row of results.
        pairs, pair_of_lane = np.unique(lane_ends, axis=0, return_inverse=True)
        # For each vector: (tick, row of the results).
        stops: list[list[tuple[int, int]]] = [[] for _ in range(vectors)]
        for row, (v, end) in enumerate(pairs.tolist()):
            stops[v].append((end, row))
        ends, begins, ticks_done = np.unique(course.ends).tolist(), course.begins.tolist(), 0
        group = LaneGroup(self, lanes, vectors, CHUNK, len(pairs))
        group_states = aligned_buffer(len(ends), self.kernel.group_state.bytes)
        group_state_at = {end: row_address(group_states, row) for row, end in enumerate(ends)}
        if course.trunk is not None:
            group.run_calls()
            self._start_from_snapshots(group, course, course.trunk)
        for first in range(course.first, course.last, CHUNK):
            until = min(first + CHUNK, course.last)
            group.first_row_tick = first
            now = first
            for end in ends:
                if first < end <= until:
                    group.compute_rows(now, end, group_state_at[end])
                    now = end
            if now < until:
                group.compute_rows(now, until)
            for v, begin in enumerate(begins):
                now = before = max(first, begin)
                for end, row in stops[v]:
                    stop = min(end, until)
                    if now < stop:
                        group.advance(v, now, stop)
                        now = stop
                    if first < end <= until:
                        group.finish(v, row, group_state_at[end])
                ticks_done += max(0, now - before)
            if ticks_done >= CALL_TICKS or until == course.last:
                group.run_calls()
                if progress is not None and ticks_done:
                    progress(ticks_done * self.width)
                ticks_done = 0
        indices = pair_of_lane.reshape(-1) * self.width + np.tile(np.arange(self.width), vectors)
        return [column[indices] for column in self.kernel.results.unpack(group.results)]

    def trunk(self, lanes: Lanes, last: int, ends: np.ndarray) -> tuple[Trunk, list[np.ndarray]]:
        """Run a vector of lanes that are all the same golden run. Return its snapshots before tick
        `last`, and its results at `ends` (ascending), each [ends].
        """
        words, shared_words = self._state_words[0], self.kernel.group_state.bytes // 4
        every = snapshot_spacing(last, len(words) + shared_words)
        group = LaneGroup(self, lanes, 1, every, max(1, len(ends)))
        state, shared = (rows.view(np.uint32)[0] for rows in (group.state, group.group_state))
        snapshots = Trunk.allocate(every, max(1, -(-last // every)), shared_words, len(words))
        result_row = {end: row for row, end in enumerate(ends.tolist())}
        now = 0
        # Stops at each snapshot and each end, and makes a row of numbers for at most `every` ticks.
        # Calls are only collected; `run_calls` makes them when a snapshot needs the state.
        for stop in sorted({*range(0, last, every), *result_row}):
            for first in range(now, stop, every):
                until = min(first + every, stop)
                group.first_row_tick = first
                group.compute_rows(first, until)
                group.advance(0, first, until)
            now = stop
            if stop in result_row:
                group.finish(0, result_row[stop])
            if stop < last and stop % every == 0:
                group.run_calls()
                snapshots.lane[stop // every] = state[words]
                snapshots.group[stop // every] = shared
        group.run_calls()
        # Each [rows * width]. Lanes are equal, so the first lane of each row is enough.
        columns = self.kernel.results.unpack(group.results)
        return snapshots, [column[:: self.width][: len(ends)] for column in columns]

    @cached_property
    def _state_words(self) -> np.ndarray:
        """[width, words]: indices of the 32-bit words of each lane's state in a row of `state`."""
        return np.stack([self.kernel.state.words(lane) for lane in range(self.width)])

    def _start_from_snapshots(self, group: LaneGroup, course: LaneCourse, golden_run: Trunk):
        # Copies states from snapshots of the golden run. Each vector begins in its own tick, with
        # equal lanes. The group's shared state begins in the tick in which the first vector begins.
        # For tick 0, `lane_begin` and `shared_begin` have already written the state.
        if course.first:
            snapshot = golden_run.group[course.first // golden_run.every]
            group.group_state.view(np.uint32)[0] = snapshot
        states = group.state.view(np.uint32)
        for v, tick in enumerate(course.begins.tolist()):
            if tick:
                # One row of words, written to each lane of the vector.
                states[v][self._state_words] = golden_run.lane[tick // golden_run.every]
