"""Engine `simd`: compiles a robot's tick to vector code for the CPU, and runs many robots.

Each robot uses one lane of the vectors. Robots with equal varied parameters form a group. Numbers
that are equal in a whole group, such as those of the nominal model, are computed once for the
group. If the groups would be too small, every lane computes all numbers. Both ways give the same
bits, and so do all vector widths. A lane's result therefore depends only on its inputs.
"""

import dataclasses
import os
from typing import Any

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.code import LaneCourse, VectorCode
from ravenjax.engines.cpu.kernel import print_kernel
from ravenjax.engines.interface import Block, BlockResult, Motion, Progress, TickProgram, Tracer
from ravenjax.engines.lanes import Lanes, Trunk
from ravenjax.ir.time_loop import split_lanes
from ravenjax.numbers import tree

MIN_LANES, MAX_LANES = 256, 1024
"""Least and greatest number of lanes of a block. With fewer lanes, the shared numbers are a large
part of the work, and Python prepares blocks more slowly than many threads compute them. With more
lanes, the last blocks leave threads idle.
"""
BLOCKS = 8
"""Least number of blocks per thread, if blocks have more than MIN_LANES lanes."""
UNSHARED_WORK = 0.5
"""Approximate extra time of a vector that also computes the shared numbers, as a fraction."""


class SimdKernel(traced.PrintedKernel):
    """A traced program and its compiled forms."""

    def __init__(
        self,
        program: TickProgram,
        lanes: int,
        objects: jit.Objects | None = None,
        signals: bool = False,
        host: jit.Host | None = None,
    ):
        """signals: every tick returns every signal, and lanes run one by one. host: CPU whose
        vectors the code is for, which must run here; None: this machine's CPU."""
        super().__init__(program, lanes, objects)
        self.signals, self._host = signals, host or jit.host_target()
        self.width = 1 if signals else self._host.width
        self._dtype = np.dtype(program.setup.precision.real)
        self.branches = 0 if signals else self.width

    def size(self, rows: int) -> int:
        """Return a number of lanes that fills whole vectors; see `interface.Kernel`."""
        return -(-rows // self.width) * self.width

    def prepare(self, block: Block, motion: Motion) -> None:
        """Trace and compile for blocks and motions like these."""
        self._code(block, motion, self._groups(block)[2])

    def run(self, block: Block, motion: Motion, progress: Progress | None = None) -> BlockResult:
        """See `interface.Kernel`."""
        return self._run(block, motion, progress)[0]

    def run_signals(self, block: Block, motion: Motion) -> tuple[BlockResult, Any]:
        """Run a block like `run`. Return also the signals of the first lane, arrays [ticks]."""
        result, out = self._run(block, motion, None)
        tick = self.forms(block, motion).traced
        # `out` is [ticks, outputs, lanes]. The first `tick.series` outputs are reference series.
        columns = np.ascontiguousarray(out[:, tick.series :, 0].T)
        # `tick.signals` has the dtype of each signal.
        signals = map(_from_slots, columns, tree.tree_leaves(tick.signals))
        return result, tree.fill_tree(tick.signals, list(signals))

    def trunk(
        self, block: Block, motion: Motion, last: int, ends: np.ndarray
    ) -> tuple[Trunk, dict[str, np.ndarray]]:
        """Return snapshots of a golden run before tick `last`, and its outcomes at `ends`, [ends].
        All lanes of `block` are this golden run, so they are one group; see `BranchingKernel`.
        """
        code, inputs = self._code(block, motion, True), traced.lane_inputs(self.program, block)
        end, members = max([last, *ends.tolist()]), np.arange(self.width)
        golden_series = self._golden_series(block, members, grouped=True, first=0, last=end)
        lanes = Lanes(inputs, golden_series, traced.motion_tables(motion), None)
        trunk, columns = code.trunk(lanes, last, ends)
        return trunk, dict(zip(self.forms(block, motion).traced.outcomes, columns, strict=True))

    def _run(self, block: Block, motion: Motion, progress: Progress | None):
        # Returns the results of a block, and the outputs of its ticks: the reference series, then
        # the signals, [ticks, outputs, lanes]. Only golden runs and signals keep the outputs.
        tick, ticks = self.forms(block, motion).traced, self.program.ticks
        inputs, group, grouped = self._groups(block)
        code, tables = self._code(block, motion, grouped), traced.motion_tables(motion)
        lanes, keep_outputs = len(group), self.signals or block.reference is None
        # With signals, which have several types, each output fills a slot of 64 bits.
        dtype = np.dtype(np.uint64) if self.signals else self._dtype
        out = np.zeros((ticks if keep_outputs else 0, code.kernel.outputs, lanes), dtype)
        outcomes = []
        # Groups, whose lanes share inputs, are computed one after the other.
        for number in range(group.max() + 1):
            members = np.flatnonzero(group == number)
            # The last lane is repeated to fill whole vectors.
            padded = np.pad(members, (0, -len(members) % self.width), "edge")
            course = self._course(block, padded, grouped)
            first, last = (0, ticks) if keep_outputs else (course.first, course.last)
            # A group that is the whole block writes into the large array `out` without a copy.
            is_whole_block = len(members) == len(padded) == lanes
            group_out = out if is_whole_block else np.zeros((*out.shape[:2], len(padded)), dtype)
            lane_inputs = [column[padded] for column in inputs]
            golden = self._golden_series(block, padded, grouped, first, last)
            vectors = Lanes(lane_inputs, golden, tables, group_out if keep_outputs else None, first)
            columns = code.run_course(vectors, course, progress)
            # `run_course` has reported the ticks that lanes run. Report the ticks that they skip.
            if progress is not None:
                progress(ticks * len(padded) - course.lane_ticks)
            outcomes = outcomes or [np.zeros(lanes, column.dtype) for column in columns]
            for column, values in zip(outcomes, columns, strict=True):
                column[members] = values[: len(members)]
            if not is_whole_block:
                out[:, :, members] = group_out[:, :, : len(members)]
        reference = out[:, : tick.series]
        if self.signals:
            reference = _from_slots(np.ascontiguousarray(reference), self._dtype)
        return BlockResult(dict(zip(tick.outcomes, outcomes, strict=True)), reference), out

    def _groups(self, block: Block):
        """Return a block's inputs, each lane's group, and whether computing by groups is faster. If
        it is not, all lanes are in group 0, and they share only what depends on the tick alone.
        """
        inputs, group = self.groups(block)
        # Vectors have lanes of one group, so the last vector of each group may not be full.
        vectors = (-(-np.bincount(group) // self.width)).sum()
        vectors_without_groups = -(-len(group) // self.width)
        grouped = bool(vectors <= (1.0 + UNSHARED_WORK) * vectors_without_groups)
        return inputs, group if grouped else np.zeros_like(group), grouped

    def _course(self, block: Block, lanes: np.ndarray, grouped: bool) -> LaneCourse:
        # Plans in which tick vectors begin and lanes end. Until a fault acts, lanes equal their
        # golden run, which their group shares, so vectors can begin at snapshots of this run. A
        # vector begins before the first of its faults acts.
        ends = np.full(len(lanes), self.program.ticks) if block.ends is None else block.ends[lanes]
        begins = np.zeros(len(lanes) // self.width, np.int64)
        golden_run = block.trunk(int(lanes[0])) if grouped else None
        if golden_run is not None and block.acts is not None:
            first_acts = block.acts[lanes].reshape(-1, self.width).min(axis=1)
            begins = golden_run.start_ticks(first_acts)
        return LaneCourse(begins, ends, golden_run)

    def _golden_series(
        self, block: Block, lanes: np.ndarray, grouped: bool, first: int, last: int
    ) -> np.ndarray:
        # Returns the series of golden runs from tick `first` to before `last`: [ticks, series] if
        # grouped, else [ticks, series, lanes]; one tick of zeros if lanes are not compared.
        if not block.compared or block.reference is None:
            series = self.program.loop.series_length(self.program.setup)
            return np.zeros((1, series) if grouped else (1, series, len(lanes)), self._dtype)
        part = dataclasses.replace(block, reference=block.reference[first:last])
        # The lanes of a group have the same golden run, so the series of the first lane is enough.
        series = part.series(lanes[:1])[:, :, 0] if grouped else part.series(lanes)
        return np.ascontiguousarray(series)

    def _code(self, block: Block, motion: Motion, grouped: bool) -> VectorCode:
        # Returns the compiled code for this block. `forms` caches it, and its text on disk.
        forms, host = self.forms(block, motion), self._host
        key = "simd", self.signals, grouped, self.width, host.text

        def print_code():
            loop = forms.traced.loop if self.signals else forms.traced.without_signals()
            parts = split_lanes(loop, len(self.program.varied), grouped)
            return print_kernel(parts, self.width, host.features)

        return forms.code(key, lambda: VectorCode(forms.printed(key, print_code), self.objects))


def _from_slots(slots: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return the numbers that slots of 64 bits begin with, in an array of the same shape."""
    # Truth values are stored as int32. Of two 32-bit numbers in a slot, the first is taken.
    numbers = slots.view(np.int32 if dtype.kind == "b" else dtype)
    return numbers[..., :: 8 // max(4, dtype.itemsize)].astype(dtype)


def lanes_of_block(runs: int, threads: int, width: int) -> int:
    """Return the lanes of a block in a campaign of `runs` runs, in vectors of `width` lanes."""
    share = -(-runs // threads)
    lanes = min(MAX_LANES, max(MIN_LANES, share // BLOCKS), share)
    return -(-lanes // width) * width


@dataclasses.dataclass(frozen=True)
class SimdEngine:
    """Engine that uses all cores of a CPU and its widest vectors."""

    objects: jit.Objects | None = None  # cache of compiled code that outlives the process
    name: str = "simd"

    @property
    def device(self) -> str:
        """The CPU in words."""
        return f"{jit.host_target().cpu}, {jit.host_target().vectors}"

    @property
    def threads(self) -> int:
        """Parallel blocks: one per core."""
        return len(os.sched_getaffinity(0))

    def compile(self, program: TickProgram, runs: int) -> SimdKernel:
        """See `interface.Engine`. Blocks do not depend on the chunk size of the results."""
        lanes = lanes_of_block(runs, self.threads, jit.host_target().width)
        return SimdKernel(program, lanes, self.objects)

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`. Lanes run one by one, with the same bits as in a campaign."""
        return Tracer(SimdKernel(program, 1, self.objects, signals=True))
