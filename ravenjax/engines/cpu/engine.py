"""Engine `simd`: the tick printed as vector code, the time loop inside, compiled in process, one
robot a vector lane.

Lanes that share their varied parameters form a group: what does not differ between them (the clean
packet, the nominal model, clocks) is computed once for all of them. Where groups would be too
small, parameters are taken as the lanes' own. Both ways give the same bits, as do all vector
widths, so a lane's result depends on its inputs alone.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from typing import Any

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.code import LaneCourse, VectorCode
from ravenjax.engines.cpu.target import CodeTarget
from ravenjax.engines.interface import Block, BlockResult, Progress, TickProgram, Tracer
from ravenjax.engines.lanes import Lanes, Trunk

MIN_LANES, MAX_LANES = 256, 1024
"""Lanes of a block: with fewer what their group shares is no small part of the work, and with many
threads Python is busier with the next block than they are with theirs; with more the last blocks
leave threads idle."""
BLOCKS = 8
"""Blocks for each thread, at least, where they have more than the fewest lanes."""

REPAID = 400_000
"""Ticks of vectors that a kernel runs in vain, about, for want of a second form of its code: to
print and compile one takes 1.3 s, and a tick of a vector 3.3 us (`quick.toml`, AVX-512 at 2 GHz).
"""
UNSHARED = 0.5
"""By how much a vector takes longer, about, that computes by itself what its group could share."""


class SimdKernel:
    """A traced program and its compiled forms."""

    def __init__(
        self,
        program: TickProgram,
        lanes: int,
        objects: jit.Objects | None = None,
        signals: bool = False,
        target: CodeTarget | None = None,
    ) -> None:
        """signals: every signal goes out in each tick, and lanes run one by one. target: this
        machine's CPU if left out."""
        self.program, self.lanes, self.signals = program, lanes, signals
        self._target: CodeTarget = target or jit.host()
        self.width = 1 if signals else self._target.width
        self._objects = objects
        self._forms: traced.Forms | None = None
        self._dtype = np.dtype(program.setup.precision.real)
        # ticks of vectors run so far for want of a form; blocks side by side may count too few
        self._vain = 0.0
        self._joined: tuple[tuple[np.ndarray, ...], np.ndarray] | None = None
        self.branches = 0 if signals else self.width

    def size(self, rows: int) -> int:
        """See `interface.Kernel`: whole vectors."""
        return -(-rows // self.width) * self.width

    def prepare(self, block: Block, motion: tuple[np.ndarray, ...]) -> None:
        """Trace and compile for blocks and motions like these."""
        self._trace(block, motion)
        self._code(block, motion, self._plan(traced.inputs(self.program, block)).grouped)

    def run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None = None
    ) -> BlockResult:
        """See `interface.Kernel`. Lanes with equal inputs are computed once."""
        return self._run(block, motion, progress)[0]

    def run_signals(self, block: Block, motion: tuple[np.ndarray, ...]) -> tuple[BlockResult, Any]:
        """As `run`, and every signal of the first lane, each leaf [ticks]."""
        result, out = self._run(block, motion, None)
        return result, self._traced.signals_of(out, _from_slots)

    def trunk(
        self, block: Block, motion: tuple[np.ndarray, ...], last: int, ends: np.ndarray
    ) -> tuple[Trunk, dict[str, np.ndarray]]:
        """See `interface.Kernel`."""
        code, inputs = self._code(block, motion, True), traced.inputs(self.program, block)
        until = max([last, *ends.tolist()])
        some = Lanes(
            inputs,
            self._given(block, np.arange(self.width), True, 0, until),
            self._tables(motion),
            None,
        )
        trunk, columns = code.trunk(some, last, ends)
        return trunk, dict(zip(self._traced.outcomes, columns, strict=True))

    def _run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None
    ) -> tuple[BlockResult, np.ndarray]:
        self._trace(block, motion)
        inputs, ticks = traced.inputs(self.program, block), self.program.ticks
        plan = self._plan(inputs if block.ends is None else [*inputs, block.ends])
        code = self._code(block, motion, plan.grouped)
        lanes, outputs, tables = len(plan.place), code.outputs, self._tables(motion)
        keep = self.signals or block.reference is None
        dtype = np.uint64 if self.signals else self._dtype
        record: np.ndarray | None = None
        outcomes: list[np.ndarray] = []
        for part in plan.parts:
            filled = np.minimum(np.arange(-(-len(part) // self.width) * self.width), len(part) - 1)
            some = plan.first[part[filled]]
            course = self._course(block, some, plan.grouped)
            first, last = (0, ticks) if keep else (course.first, course.last)
            out = np.zeros((ticks, outputs, len(some)), dtype) if keep else None
            tick_inputs = self._given(block, some, plan.grouped, first, last)
            vectors = Lanes([column[some] for column in inputs], tick_inputs, tables, out, first)
            columns = code.follow(vectors, course, progress)
            if progress is not None:  # what nobody had to run is done, too
                progress(ticks * len(some) - self.width * course.vector_ticks)
            outcomes = outcomes or [np.zeros(lanes, column.dtype) for column in columns]
            mine = np.flatnonzero(np.isin(plan.place, part))
            at = np.searchsorted(part, plan.place[mine])
            for column, values in zip(outcomes, columns, strict=True):
                column[mine] = values[at]
            if out is not None and len(mine) == lanes and (at == np.arange(lanes)).all():
                record = out[:, :, :lanes]  # as large as all that runs at a time: not held twice
            elif out is not None:
                record = np.zeros((ticks, outputs, lanes), dtype) if record is None else record
                record[:, :, mine] = out[:, :, at]
        record = np.zeros((0, outputs, lanes), dtype) if record is None else record
        named = dict(zip(self._traced.outcomes, outcomes, strict=True))
        reference = record[:, : self._traced.series]
        if self.signals:
            reference = np.ascontiguousarray(reference).view(self._dtype)[
                :, :, :: 8 // self._dtype.itemsize
            ]
        return BlockResult(named, reference), record

    def _course(self, block: Block, lanes: np.ndarray, grouped: bool) -> LaneCourse:
        """From where to where whole vectors of lanes run; those of a group have the same golden
        run.
        """
        ends = np.full(len(lanes), self.program.ticks) if block.ends is None else block.ends[lanes]
        begins = np.zeros(len(lanes) // self.width, np.int64)
        trunk = block.trunk(int(lanes[0])) if grouped else None
        if trunk is not None and block.acts is not None:
            begins = trunk.begins(block.acts[lanes].reshape(-1, self.width).min(axis=1))
        return LaneCourse(begins, ends, trunk)

    def _given(
        self, block: Block, lanes: np.ndarray, grouped: bool, first: int, last: int
    ) -> np.ndarray:
        """The golden runs' series in these ticks: of a group, whose lanes share one, or of each
        lane.
        """
        series = self._traced.series
        if not block.compared or block.reference is None:
            return np.zeros((1, series) if grouped else (1, series, len(lanes)), self._dtype)
        some = dataclasses.replace(block, reference=block.reference[first:last])
        return np.ascontiguousarray(
            some.series(lanes[:1])[:, :, 0] if grouped else some.series(lanes)
        )

    def _plan(self, inputs: list[np.ndarray]) -> _Plan:
        # Runs without faults of their own and without varied parameters are all alike.
        alike = np.zeros(1, np.int64), np.zeros(self.lanes, np.int64)
        first, place = _distinct(inputs) if inputs else alike
        varied = [column[first] for column in inputs[: len(self.program.varied)]]
        group = _distinct(varied)[1] if varied else np.zeros(len(first), np.int64)
        if not (grouped := self._runs_by_group(np.bincount(group))):
            group = np.zeros_like(group)
        return _Plan(
            first, place, grouped, [np.flatnonzero(group == g) for g in range(group.max() + 1)]
        )

    def _runs_by_group(self, sizes: np.ndarray) -> bool:
        """Whether lanes of groups of these sizes run group by group: where that is cheaper.

        Where only the other form of code is there, it serves until it has cost as much as a second
        form would.
        """
        apart = (1.0 + UNSHARED) * -(-sizes.sum() // self.width)
        costs = {True: float((-(-sizes // self.width)).sum()), False: float(apart)}
        best = costs[True] <= costs[False]
        if self._forms is None or self.signals or self._forms.holds(self._key(best)):
            return best
        if not self._forms.holds(self._key(not best)):
            return best
        self._vain += (costs[not best] - costs[best]) * self.program.ticks
        return best if self._vain > REPAID else not best

    def _tables(self, motion: tuple[np.ndarray, ...]) -> np.ndarray:
        """The columns of the motion one after the other."""
        if self._joined is None or self._joined[0] is not motion:
            self._joined = (
                motion,
                np.concatenate([np.ascontiguousarray(column) for column in motion]),
            )
        return self._joined[1]

    @property
    def _traced(self) -> traced.TracedTick:
        assert self._forms is not None
        return self._forms.traced

    def _key(self, grouped: bool) -> tuple[Any, ...]:
        return self._target.name, self.signals, grouped, self.width, self._target.text

    def _trace(self, block: Block, motion: tuple[np.ndarray, ...]) -> traced.Forms:
        self._forms = self._forms or traced.forms(self.program, block, motion, self._objects)
        return self._forms

    def _code(self, block: Block, motion: tuple[np.ndarray, ...], grouped: bool) -> VectorCode:
        forms = self._trace(block, motion)

        def make() -> VectorCode:
            loop = forms.traced.loop if self.signals else forms.traced.without_signals()
            printed = functools.partial(forms.printed, self._key(grouped))
            shared = len(self.program.varied)
            return VectorCode(
                loop, shared, grouped, self.width, self._objects, printed, self._target
            )

        return forms.code(self._key(grouped), make)


@dataclasses.dataclass(frozen=True)
class _Plan:
    """How the lanes of a block are run."""

    first: np.ndarray  # [distinct], lane in which each distinct one first occurs
    place: np.ndarray  # [lanes], which distinct one a lane is
    grouped: bool  # lanes that run together share their varied parameters
    parts: list[np.ndarray]  # distinct lanes that run together, ascending


def _distinct(columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Of rows of these columns that are equal bit by bit: where each first occurs, and for each
    row which it is.
    """
    words = [
        np.ascontiguousarray(c).view(f"u{c.dtype.itemsize}").astype(np.uint64) for c in columns
    ]
    if any(
        len(np.unique(column)) == len(column) for column in words
    ):  # as drawn values are, which costs less to see
        return np.arange(len(words[0])), np.arange(len(words[0]))
    _, first, place = np.unique(
        np.stack(words, axis=1), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)  # as they come
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[place.reshape(-1)]


def _from_slots(column: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Numbers that stand in slots of 64 bits each."""
    return column.view(np.int32 if dtype.kind == "b" else dtype)[
        :: 8 // max(4, dtype.itemsize)
    ].astype(dtype)


def lanes_of_block(runs: int, threads: int, width: int) -> int:
    """Lanes of a block in a campaign of so many runs: whole vectors."""
    share = -(-runs // threads)
    lanes = min(MAX_LANES, max(MIN_LANES, share // BLOCKS), share)
    return -(-lanes // width) * width


@dataclasses.dataclass(frozen=True)
class SimdEngine:
    """All cores of a CPU, its widest vectors."""

    objects: jit.Objects | None = None  # compiled code kept between processes
    name: str = "simd"

    @property
    def device(self) -> str:
        """The CPU in words."""
        return f"{jit.host().cpu}, {jit.host().vectors}"

    @property
    def threads(self) -> int:
        """One block a core."""
        return len(os.sched_getaffinity(0))

    def compile(self, program: TickProgram, runs: int) -> SimdKernel:
        """See `interface.Engine`. The block never depends on the chunk that results are stored
        in.
        """
        lanes = lanes_of_block(runs, self.threads, jit.host().width)
        return SimdKernel(traced.printable(program), lanes, self.objects)

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`. Lanes run one by one, to the same bits as in a campaign."""
        return Tracer(SimdKernel(traced.printable(program), 1, self.objects, signals=True))
