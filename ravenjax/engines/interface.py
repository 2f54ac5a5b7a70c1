"""Defines the interface of an engine, which is a program that computes the tick of many robots.

An engine divides robots into *blocks* and advances a block over all ticks of a run. Each robot of a
block is a *lane*. A lane's result depends on its inputs, but not on the division into blocks.
"""

from __future__ import annotations

import dataclasses
import importlib
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ravenjax.numbers import paths, tree
from ravenjax.numbers.vec import where

Progress = Callable[[int], None]
"""Called with the number of ticks just finished, all lanes of a block together."""
Motion = tuple[np.ndarray, ...]
"""Columns of the operator's motion, each 1-D with one number per step of the motion."""

TIMES = re.compile("_ms$|^(near_ms|differs|leaves):")
"""Names of outcomes that are times; the last three are those of `stages.explained`."""


class Loop(Protocol):
    """The functions of a robot that an engine calls: first state, one tick, and outcomes. `setup`
    is specific to the robot. `params`, `state` and `signals` are records of single numbers.
    `faults` is `ravenjax.faults.fault.Faults`. `ravenjax.robots` explains what a robot is.
    """

    __name__: str

    def init(self, setup: Any, params: Any) -> Any:
        """Return the state before the first tick."""
        ...

    def advance(
        self, setup: Any, params: Any, faults: Any, state: Any, now: Any, motion: Any, golden: Any
    ) -> tuple[Any, tuple[Any, ...], Any]:
        """Compute one tick; return the new state, the reference series, and every signal. The
        reference series are the numbers with which faulty runs are compared. now: int32, ticks
        since the run began. motion: columns of the operator's motion, each a 1-D array. golden:
        reference series of the golden run in this tick.
        """
        ...

    def series_length(self, setup: Any) -> int:
        """Return the number of numbers in the reference series."""
        ...

    def outcomes(self, setup: Any, params: Any, state: Any) -> dict[str, Any]:
        """Return the outcomes of the run so far: columns of the result table before the verdict.
        Times, with names that end in `_ms`, are in ticks.
        """
        ...

    def make_injector(self, setup: Any, faults: Any, state: Any, clock: Any) -> Any:
        """Return the `ravenjax.faults.injection.Injector` of a tick. state: with open windows."""
        ...

    def name_signals(self, setup: Any, signals: Any) -> Mapping[str, Any]:
        """Return every signal by its name, for time series and comparisons. There are at least
        fault_active (bool of each slot), live (bool), and detectors
        (`stages.detectors.DetectorsState`).
        """
        ...


@dataclasses.dataclass(frozen=True)
class TickProgram:
    """The settings from which a campaign's kernel is compiled. Every field affects the code."""

    module: str  # dotted name of the robot's `Loop`; a program is sent between processes
    setup: Any  # the robot's subclass of `ravenjax.numbers.setup.Setup`
    params: Any  # the robot's parameters that all runs share, as plain numbers
    varied: tuple[str, ...]  # paths of the parameters that differ between runs
    ticks: int  # length of a run
    ends: bool = False  # True if lanes end at different ticks, `Block.ends`

    @property
    def loop(self) -> Loop:
        """The robot's tick."""
        return importlib.import_module(self.module)  # type: ignore[return-value]

    def params_of(self, varied: Sequence[Any]) -> Any:
        """Return a run's parameters. varied: its values at the paths `self.varied`, in order."""
        record = self.params
        for path, value in zip(self.varied, varied, strict=True):
            record = paths.assign_numbers(record, self.setup, path, value)
        return record

    def begin(self, varied: Sequence[Any]) -> Any:
        """Return the state of a lane before its first tick."""
        return self.loop.init(self.setup, self.params_of(varied))

    def step(
        self,
        varied: Sequence[Any],
        faults: Any,
        end: tuple[Any, ...],
        state: Any,
        now: Any,
        golden: Any,
        motion: Any,
    ) -> tuple[Any, Any, Any]:
        """Advance a lane as `Loop.advance` does. end: (tick,) from which on the state does not
        change, or () if the lane runs to the end.
        """
        lane = self.setup, self.params_of(varied), faults
        new, series, signals = self.loop.advance(*lane, state, now, motion, golden)
        return where(now < end[0], new, state) if end else new, series, signals

    def finish(self, varied: Sequence[Any], state: Any) -> dict[str, Any]:
        """Return the outcomes of a lane, with times in ms instead of ticks."""
        found = self.loop.outcomes(self.setup, self.params_of(varied), state)
        return {
            name: self.setup.to_ms(value) if TIMES.search(name) else value
            for name, value in found.items()
        }


NO_REFERENCE = np.zeros((0, 0, 0), np.float32)
"""Reference of a block whose lanes have no golden run and return only outcomes."""


@dataclasses.dataclass(frozen=True)
class Block:
    """The inputs of one block, NumPy arrays with one entry per lane."""

    varied: Mapping[str, np.ndarray]  # path -> [lanes]
    faults: Any  # faults.fault.Faults of arrays [lanes]
    # [ticks, series, golden runs]; None: the lanes are golden runs; NO_REFERENCE: no reference
    reference: np.ndarray | None
    # int [lanes]: each lane's golden run, an index of the last axis of `reference`; None: one per
    # lane, in order.
    golden: np.ndarray | None = None
    # int [lanes]: until this tick a lane has the same bits as its golden run; None: unknown.
    acts: np.ndarray | None = None
    # int [lanes]: the first tick that a lane does not run; None: all lanes run to the end.
    ends: np.ndarray | None = None
    rows: int | None = None  # number of lanes, from the first, whose results are read; None: all
    # For each golden run, its snapshots, from which lanes may start (`BranchingKernel.trunk`), or
    # None; empty: every lane starts in tick 0.
    trunks: Sequence[Any] = ()

    @property
    def compared(self) -> bool:
        """Whether the lanes are compared with golden runs."""
        return self.reference is not None and len(self.reference) > 0

    @property
    def lanes(self) -> int:
        """Number of lanes; 0 if there is no array of lanes from which to read it."""
        arrays = [*self.varied.values(), *tree.tree_leaves(self.faults), self.golden, self.acts]
        return next((len(array) for array in arrays if array is not None), 0)

    def select_lanes(self, lanes: np.ndarray) -> Block:
        """Return a block of the lanes with these indices (int), which may repeat. `reference` and
        `trunks` still contain all golden runs.
        """

        def pick(column):
            return None if column is None else np.asarray(column)[lanes]

        return dataclasses.replace(
            self,
            varied={path: pick(values) for path, values in self.varied.items()},
            faults=tree.map_leaves(pick, self.faults),
            golden=self.golden_of(lanes),
            acts=pick(self.acts),
            ends=pick(self.ends),
        )

    def golden_of(self, lanes: Any) -> Any:
        """Return the indices of these lanes' golden runs."""
        return lanes if self.golden is None else self.golden[lanes]

    def series(self, lanes: np.ndarray) -> np.ndarray:
        """Return the reference series of these lanes' golden runs, [ticks, series, len(lanes)]."""
        assert self.reference is not None
        return self.reference.take(self.golden_of(lanes), axis=2)

    def trunk(self, lane: int) -> Any:
        """Return the kernel's snapshots of a lane's golden run, or None."""
        return self.trunks[self.golden_of(lane)] if self.trunks else None


@dataclasses.dataclass(frozen=True)
class BlockResult:
    """The results of one block."""

    outcomes: dict[str, np.ndarray]  # outcome -> [lanes]
    reference: np.ndarray
    """[ticks, series, lanes], the reference series of golden runs; 0 ticks for other runs.

    Numbers after a lane's end are arbitrary. Lanes from `Block.rows` on may be left out.
    """


class Kernel(Protocol):
    """A compiled program."""

    lanes: int  # of a block, at most
    # Number of lanes of a `BranchingKernel` that start together from a snapshot of their golden
    # run; 0: every lane runs from the beginning.
    branches: int

    def size(self, rows: int) -> int:
        """Return the number of lanes of a block for `rows` runs, 1 to `lanes`."""
        ...

    def prepare(self, block: Block, motion: Motion) -> None:
        """Trace and compile for blocks and motions of these types, unless this was done before."""
        ...

    def run(self, block: Block, motion: Motion, progress: Progress | None = None) -> BlockResult:
        """Run one block. May be called from several threads."""
        ...


class BranchingKernel(Kernel, Protocol):
    """A kernel whose lanes can start from snapshots of their golden run."""

    def trunk(
        self, block: Block, motion: Motion, last: int, ends: np.ndarray
    ) -> tuple[Any, dict[str, np.ndarray]]:
        """Return snapshots of a golden run before tick `last`, and its outcomes at `ends`, [ends].
        Runs whose fault begins to act in tick `last` or before can start from a snapshot (see
        `Block.trunks`). block: the golden run in each of the `size(1)` lanes of a smallest block,
        with its reference series. ends: int [ends], ascending.
        """
        ...


class Engine(Protocol):
    """Compiles programs to kernels. `selection.ENGINES` lists the engines and their properties."""

    @property
    def name(self) -> str:
        """Name of the engine, for `--engine`."""
        ...

    @property
    def device(self) -> str:
        """Device of the engine, in words."""
        ...

    @property
    def threads(self) -> int:
        """Number of blocks that run in parallel."""
        ...

    def compile(self, program: TickProgram, runs: int) -> Kernel:
        """Return the kernel of `program`, with blocks sized for a campaign of `runs` runs."""
        ...

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """Return a tracer of single blocks of `lanes` lanes, compiled once for any campaign."""
        ...


@dataclasses.dataclass(frozen=True)
class Tracer:
    """Runs blocks one after the other with the same compiled code."""

    kernel: Any  # of an engine; its `run_signals` also returns every signal of the first lane

    def run(
        self, golden: Block, block: Block, motion: Motion
    ) -> tuple[BlockResult, BlockResult, Any]:
        """Return the results of both blocks, and every signal of `block`'s first lane, [ticks].
        `golden` is the same block without faults. It runs first, and its reference series are those
        with which `block` is compared.
        """
        results = self.kernel.run(golden, motion)
        block = dataclasses.replace(block, reference=results.reference)
        return results, *self.kernel.run_signals(block, motion)
