"""What an engine is: the tick, run for many robots.

An engine advances *blocks*: some number of lanes, one robot a lane, over all ticks of a run. A
lane's result depends on nothing but its own inputs, so it is the same in any block of any size,
with any number of threads.
"""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ravenjax.numbers import paths, tree
from ravenjax.numbers.vec import where

Progress = Callable[[int], None]
"""Called with the number of ticks just finished, all lanes of a block together."""


class Loop(Protocol):
    """A robot's tick, its beginning and its end: all that an engine knows of a robot.

    `setup` is the robot's own, `params`, `state` and `signals` are records of single numbers,
    `faults` is `ravenjax.faults.fault.Faults`; see `ravenjax.robots` for what a robot is.
    """

    __name__: str

    def init(self, setup: Any, params: Any) -> Any:
        """The state before the first tick."""
        ...

    def advance(
        self, setup: Any, params: Any, faults: Any, state: Any, now: Any, motion: Any, golden: Any
    ) -> tuple[Any, tuple[Any, ...], Any]:
        """One millisecond: the new state, the own series, and every signal.

        now: int32, ticks since the run began. motion: columns of the operator's motion, each a 1-D
        array. golden: the series of the golden run in this tick, as `advance` returned it there.
        """
        ...

    def series_length(self, setup: Any) -> int:
        """How many numbers the series has."""
        ...

    def outcomes(self, setup: Any, params: Any, state: Any) -> dict[str, Any]:
        """What became of the run so far: columns of the result table before the verdict."""
        ...


@dataclasses.dataclass(frozen=True)
class TickProgram:
    """What a campaign's kernel is made of; everything here picks code."""

    # dotted name of the module that is the robot's `Loop`: a program travels between processes
    module: str
    setup: Any  # the robot's own kind of `ravenjax.numbers.setup.Setup`
    params: Any  # the robot's parameters, plain numbers: what all runs share
    varied: tuple[str, ...]  # paths of the parameters that differ between runs
    ticks: int  # length of a run
    ends: bool = False  # lanes end at ticks of their own, `Block.ends`

    @property
    def loop(self) -> Loop:
        """The robot's tick."""
        return importlib.import_module(self.module)  # type: ignore[return-value]

    def params_of(self, varied: Sequence[Any]) -> Any:
        """The parameters of a run in which those that vary have these values."""
        record = self.params
        for path, value in zip(self.varied, varied, strict=True):
            record = paths.assign(record, self.setup, path, value)
        return record

    def begin(self, varied: Sequence[Any]) -> Any:
        """The state of a lane before its first tick."""
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
        """`Loop.advance` of a lane; from tick `end` on, if there is one, its state stays."""
        params = self.params_of(varied)
        new, series, signals = self.loop.advance(
            self.setup, params, faults, state, now, motion, golden
        )
        return where(now < end[0], new, state) if end else new, series, signals

    def finish(self, varied: Sequence[Any], state: Any) -> dict[str, Any]:
        """The outcomes of a lane."""
        return self.loop.outcomes(self.setup, self.params_of(varied), state)


NO_REFERENCE = np.zeros((0, 0, 0), np.float32)
"""Reference of a block whose lanes are compared with nothing, and leave nothing behind but
outcomes.
"""


@dataclasses.dataclass(frozen=True)
class Block:
    """The inputs of one block, NumPy arrays with one entry a lane."""

    varied: Mapping[str, np.ndarray]  # path -> [lanes]
    faults: Any  # faults.fault.Faults of arrays [lanes]
    reference: (
        np.ndarray | None
    )  # [ticks, series, golden runs]; None: golden runs; NO_REFERENCE: none
    golden: np.ndarray | None = (
        None  # int [lanes], which golden run is a lane's; None: one a lane, in their order
    )
    acts: np.ndarray | None = (
        None  # int [lanes], up to this tick a lane is its golden run to the bit; None: not known
    )
    ends: np.ndarray | None = (
        None  # int [lanes], the first tick that a lane does not run; None: all run whole
    )
    rows: int | None = None  # lanes that are read afterwards, the first ones; None: all
    trunks: Sequence[
        Any
    ] = ()  # of each golden run what `Kernel.trunk` made of it, or None; empty: None of each

    @property
    def compared(self) -> bool:
        """Whether it has golden runs that its lanes are compared with."""
        return self.reference is not None and len(self.reference) > 0

    @property
    def lanes(self) -> int:
        """How many lanes it has; 0 where nothing differs between them."""
        arrays = [*self.varied.values(), *tree.leaves(self.faults), self.golden, self.acts]
        return next((len(array) for array in arrays if array is not None), 0)

    def head(self, lanes: int) -> Block:
        """Its first lanes."""
        return dataclasses.replace(
            self,
            varied={path: values[:lanes] for path, values in self.varied.items()},
            faults=tree.mapped(lambda leaf: leaf[:lanes], self.faults),
            golden=None if self.golden is None else self.golden[:lanes],
            acts=None if self.acts is None else self.acts[:lanes],
            ends=None if self.ends is None else self.ends[:lanes],
        )

    def series(self, lanes: np.ndarray) -> np.ndarray:
        """[ticks, series, len(lanes)]: the golden runs of these lanes; only of a block that has
        a reference.
        """
        assert self.reference is not None
        return self.reference[:, :, lanes if self.golden is None else self.golden[lanes]]

    def trunk(self, lane: int) -> Any:
        """What the kernel made of a lane's golden run; None where there is nothing."""
        return (
            self.trunks[lane if self.golden is None else self.golden[lane]] if self.trunks else None
        )


@dataclasses.dataclass(frozen=True)
class BlockResult:
    """What came out of one block."""

    outcomes: dict[str, np.ndarray]  # outcome -> [lanes]
    reference: np.ndarray
    """[ticks, series, lanes], what faulty runs are compared with: of each lane in the ticks before
    its end. Empty unless golden runs ran."""


class Kernel(Protocol):
    """A compiled program."""

    lanes: int  # of a block, at most
    # lanes of a `BranchingKernel` that go on from their golden run together; 0: every lane runs
    # whole
    branches: int

    def size(self, rows: int) -> int:
        """Lanes of a block of so many rows, 1 to `lanes`; those beyond the rows are filled and
        left unread.
        """
        ...

    def prepare(self, block: Block, motion: tuple[np.ndarray, ...]) -> None:
        """Trace and compile for blocks and motions of these types; done once, and by `run` if
        not before.
        """
        ...

    def run(
        self, block: Block, motion: tuple[np.ndarray, ...], progress: Progress | None = None
    ) -> BlockResult:
        """Run one block; `motion` are the columns of the operator's motion. May be called from
        several threads.
        """
        ...


class BranchingKernel(Kernel, Protocol):
    """A kernel whose lanes can go on from where their golden run was."""

    def trunk(
        self, block: Block, motion: tuple[np.ndarray, ...], last: int, ends: np.ndarray
    ) -> tuple[Any, dict[str, np.ndarray]]:
        """What lanes can go on from whose faults act in tick `last` at the latest, for
        `Block.trunks`.

        block: `size(1)` lanes without faults, all alike, with their golden run's series. Beside it
        the outcomes of the golden run at `ends` (int [ends], ascending), each [ends].
        """
        ...


class Engine(Protocol):
    """Turns programs into kernels."""

    @property
    def name(self) -> str:
        """As `--engine` takes it."""
        ...

    @property
    def device(self) -> str:
        """What it runs on, in words."""
        ...

    @property
    def threads(self) -> int:
        """Blocks that are worth running side by side."""
        ...

    def compile(self, program: TickProgram, runs: int) -> Kernel:
        """The kernel of `program`, its block sized for a campaign of `runs` runs."""
        ...

    def tracer(self, program: TickProgram, lanes: int) -> Tracer:
        """What runs single blocks of so many lanes and keeps every signal; compiled apart from
        any campaign, once.
        """
        ...


class SignalKernel(Protocol):
    """A compiled program that can keep every signal."""

    def run(self, block: Block, motion: tuple[np.ndarray, ...]) -> BlockResult:
        """See `Kernel`."""
        ...

    def run_signals(self, block: Block, motion: tuple[np.ndarray, ...]) -> tuple[BlockResult, Any]:
        """As `run`, and every signal of the first lane: a record of [ticks]."""
        ...


@dataclasses.dataclass(frozen=True)
class Tracer:
    """Runs blocks one after the other with the same compiled code."""

    kernel: SignalKernel

    def run(
        self, golden: Block, block: Block, motion: tuple[np.ndarray, ...]
    ) -> tuple[BlockResult, BlockResult, Any]:
        """Results of `golden` and of `block`, and every signal of the block's first lane: a record
        of [ticks].

        `golden` is the same block without faults.
        """
        own = self.kernel.run(golden, motion)
        return own, *self.kernel.run_signals(
            dataclasses.replace(block, reference=own.reference), motion
        )
