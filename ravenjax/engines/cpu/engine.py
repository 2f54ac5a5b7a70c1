"""Engine `simd`: the tick printed as vector code, the time loop inside, compiled in process, one robot a vector lane.

Lanes that share their varied parameters form a group: what does not differ between them (the clean packet, the nominal
model, clocks) is computed once for all of them. Where groups would be too small, parameters are taken as the lanes'
own. Both ways give the same bits, as do all vector widths, so a lane's result depends on its inputs alone.
"""

from __future__ import annotations

import dataclasses
import os
from typing import Any

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.code import VectorCode
from ravenjax.engines.interface import Block, BlockResult, Progress, TickProgram, Tracer
from ravenjax.engines.lanes import Lanes

MAX_LANES = 256
"""Lanes of a block: what their group shares is then a small part of the work."""


class SimdKernel:
    """A traced program and its compiled forms."""

    def __init__(
        self, program: TickProgram, lanes: int, objects: jit.Objects | None = None, signals: bool = False
    ) -> None:
        """signals: every signal goes out in each tick, and lanes run one by one."""
        self.program, self.lanes, self.signals = program, lanes, signals
        self.width = 1 if signals else jit.host().width
        self._objects = objects
        self._forms: traced.Forms | None = None
        self._dtype = np.dtype(program.setup.precision.real)

    def size(self, rows: int) -> int:
        """See `interface.Kernel`: whole vectors."""
        return -(-rows // self.width) * self.width

    def prepare(self, block: Block, motion: tuple[np.ndarray, ...]) -> None:
        """Trace and compile for blocks and motions like these."""
        self._code(block, motion, self._plan(traced.inputs(self.program, block)).grouped)

    def run(self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None = None) -> BlockResult:
        """See `interface.Kernel`. Lanes with equal inputs are computed once."""
        return self._run(block, motion, progress)[0]

    def run_signals(self, block: Block, motion: tuple[np.ndarray, ...]) -> tuple[BlockResult, Any]:
        """As `run`, and every signal of the first lane, each leaf [ticks]."""
        result, out = self._run(block, motion, None)
        assert self._forms is not None
        return result, self._forms.traced.signals_of(out, _from_slots)

    def _run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None
    ) -> tuple[BlockResult, np.ndarray]:
        inputs = traced.inputs(self.program, block)
        plan = self._plan(inputs)
        code = self._code(block, motion, plan.grouped)
        assert self._forms is not None
        own, ticks, lanes = self._forms.traced, self.program.ticks, len(plan.place)
        series = own.series
        tables = np.concatenate([np.ascontiguousarray(column) for column in motion])
        keep = self.signals or block.reference is None
        record = np.zeros((ticks if keep else 0, code.outputs, lanes), np.uint64 if self.signals else self._dtype)
        outcomes: list[np.ndarray] = []
        for part in plan.parts:
            lanes_of_part = plan.first[
                part[np.minimum(np.arange(-(-len(part) // self.width) * self.width), len(part) - 1)]
            ]
            out = np.zeros((ticks, code.outputs, len(lanes_of_part)), record.dtype) if keep else None
            tick_inputs = _given(block, lanes_of_part, code.grouped, series, self._dtype)
            columns = code.run(
                Lanes([column[lanes_of_part] for column in inputs], tick_inputs, tables, out), ticks, progress
            )
            outcomes = outcomes or [np.zeros(lanes, column.dtype) for column in columns]
            mine = np.flatnonzero(np.isin(plan.place, part))
            at = np.searchsorted(part, plan.place[mine])
            for column, values in zip(outcomes, columns, strict=True):
                column[mine] = values[at]
            if out is not None:
                record[:, :, mine] = out[:, :, at]
        named = dict(zip(own.outcomes, outcomes, strict=True))
        reference = record[:, :series]
        if self.signals:
            reference = np.ascontiguousarray(reference).view(self._dtype)[:, :, :: 8 // self._dtype.itemsize]
        return BlockResult(named, reference), record

    def _plan(self, inputs: list[np.ndarray]) -> _Plan:
        # Runs without faults of their own and without varied parameters are all alike.
        alike = np.zeros(1, np.int64), np.zeros(self.lanes, np.int64)
        first, place = _distinct(inputs) if inputs else alike
        varied = [column[first] for column in inputs[: len(self.program.varied)]]
        group = _distinct(varied)[1] if varied else np.zeros(len(first), np.int64)
        vectors = -(-np.bincount(group) // self.width)
        grouped = bool(vectors.sum() <= 2 * -(-len(first) // self.width))
        parts = [np.flatnonzero(group == g) for g in range(len(vectors))] if grouped else [np.arange(len(first))]
        return _Plan(first, place, grouped, parts)

    def _code(self, block: Block, motion: tuple[np.ndarray, ...], grouped: bool) -> VectorCode:
        self._forms = forms = self._forms or traced.forms(self.program, block, motion)

        def make() -> VectorCode:
            loop = forms.traced.loop if self.signals else forms.traced.without_signals()
            return VectorCode(loop, len(self.program.varied), grouped, self.width, self._objects)

        return forms.code(("simd", self.signals, grouped, self.width), make)


@dataclasses.dataclass(frozen=True)
class _Plan:
    """How the lanes of a block are run."""

    first: np.ndarray  # [distinct], lane in which each distinct one first occurs
    place: np.ndarray  # [lanes], which distinct one a lane is
    grouped: bool
    parts: list[np.ndarray]  # distinct lanes that run together, ascending: a group each, or all


def _distinct(columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Of rows of these columns that are equal bit by bit: where each first occurs, and for each row which it is."""
    words = [np.ascontiguousarray(c).view(f"u{c.dtype.itemsize}").astype(np.uint64) for c in columns]
    _, first, place = np.unique(np.stack(words, axis=1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # as they come
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[place.reshape(-1)]


def _given(block: Block, lanes: np.ndarray, grouped: bool, series: int, dtype: np.dtype) -> np.ndarray:
    """The golden runs' series as the code reads it: of a group, whose lanes share one, or of each lane."""
    if block.reference is None:
        return np.zeros((1, series) if grouped else (1, series, len(lanes)), dtype)
    return np.ascontiguousarray(block.series(lanes[:1])[:, :, 0] if grouped else block.series(lanes))


def _from_slots(column: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Numbers that stand in slots of 64 bits each."""
    return column.view(np.int32 if dtype.kind == "b" else dtype)[:: 8 // max(4, dtype.itemsize)].astype(dtype)


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
        """See `interface.Engine`. The block never depends on the chunk that results are stored in."""
        width, share = jit.host().width, -(-runs // self.threads)
        return SimdKernel(traced.unrolled(program), min(MAX_LANES, -(-share // width) * width), self.objects)

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """See `interface.Engine`. Lanes run one by one, to the same bits as in a campaign."""
        return Tracer(SimdKernel(traced.unrolled(program), 1, self.objects, signals=True))
