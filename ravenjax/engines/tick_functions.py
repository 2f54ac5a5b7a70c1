"""What is traced of a robot's tick for a program: three functions of one lane, and what their
numbers are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines.interface import Block, TickProgram
from ravenjax.numbers import tree
from ravenjax.numbers.vec import where


def frozen(now: Any, own_end: tuple[Any, ...], new: Any, state: Any) -> Any:
    """The state after tick `now`: as it was where the lane has ended."""
    return where(now < own_end[0], new, state) if own_end else new


class LaneTypes(NamedTuple):
    """Types of a lane's inputs."""

    varied: list[np.dtype]
    faults: Any
    end: tuple[np.dtype, ...]


@dataclasses.dataclass(frozen=True)
class TickFunctions:
    """Beginning, step and end of one lane of `program`."""

    program: TickProgram

    @property
    def series(self) -> int:
        """Numbers of the reference series."""
        return self.program.loop.series_length(self.program.setup)

    def lane_types(self, block: Block) -> LaneTypes:
        """Types of a lane of blocks like this one."""
        return LaneTypes(
            [np.asarray(block.varied[path]).dtype for path in self.program.varied],
            tree.mapped(lambda leaf: np.asarray(leaf).dtype, block.faults),
            (np.dtype(np.int32),) if self.program.ends else (),
        )

    def begin(self, varied: Any, faults: Any, end: Any) -> Any:
        """The state before the first tick."""
        return self.program.loop.init(self.program.setup, self.program.params_of(varied))

    def step(
        self,
        varied: Any,
        faults: Any,
        end: Any,
        state: Any,
        now: Any,
        golden: Sequence[Any],
        motion: Any,
    ) -> tuple[Any, Any, Any]:
        """The state after tick `now`, the own series, all signals."""
        program = self.program
        params = program.params_of(varied)
        new, series, signals = program.loop.advance(
            program.setup, params, faults, state, now, motion, golden
        )
        return frozen(now, end, new, state), series, signals

    def finish(self, varied: Any, faults: Any, end: Any, state: Any) -> dict[str, Any]:
        """The outcomes."""
        return self.program.loop.outcomes(self.program.setup, self.program.params_of(varied), state)
