"""Counts the operations of the generated code for a tick by stage, to find the stages that are
worth optimising.

    python analysis/engines/tick_operations.py
"""

import dataclasses
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any
from unittest import mock

from jax.extend import core

sys.path.append(str(Path(__file__).resolve().parents[1]))

from bench.engines import list_operations
from bench.workload import Workload
from ravenjax.engines import traced
from ravenjax.ir import builder, lowering
from ravenjax.ir.program import Operation, Program
from ravenjax.ir.time_loop import split_lanes

STAGES = frozenset(("stages", "plant", "console"))
"""Folders, of a robot or common to all, whose files are stages."""


@dataclasses.dataclass(frozen=True)
class Operations:
    """Scalar operations of one tick by stage, without those that only some ticks need. A fused
    multiply-add counts as one.
    """

    lane: Mapping[str, int]  # in every run
    shared: Mapping[str, int]  # once for all runs that share their parameters

    @property
    def per_lane(self) -> int:
        """Return all operations in every run."""
        return sum(self.lane.values())


def count(workload: Workload) -> Operations:
    """Count the operations of the workload's tick."""
    program = workload.plan.program
    with (
        mock.patch.object(lowering, "Builder", _NotingBuilder),
        mock.patch.object(builder, "Builder", _NotingBuilder),
        mock.patch.object(lowering._Lowering, "_equation", _noting_equation),
        mock.patch.object(traced, "contract_to_fma", _noting_contraction),
    ):
        trace = traced.trace_tick(program, workload.golden_runs(1), workload.plan.columns)
    stages = dict(enumerate(_STAGES_OF[id(trace.loop.step.operations)]))
    parts = list_operations(split_lanes(trace.without_signals(), len(program.varied), True))
    return Operations(*(Counter(stages.get(i) or "tick.glue" for i in part) for part in parts))


_STAGES_OF: dict[int, list[str]] = {}
"""Stage of each operation of a program, by the identity of its operations."""
_EQUATION, _FUSED = lowering._Lowering._equation, builder._fuse


class _NotingBuilder(builder.Builder):
    """Notes the stage of each operation that it writes."""

    now = ""  # stage of the operations that are being written

    def __init__(self) -> None:
        super().__init__()
        self.stages: list[str] = []
        _NotingBuilder.now = ""

    def _write(self, operation: Operation) -> int:
        number = super()._write(operation)
        if number == len(self.stages):
            self.stages.append(_NotingBuilder.now)
        return number

    def program(self, outputs: Sequence[int]) -> Program:
        made = super().program(outputs)
        _STAGES_OF[id(made.operations)] = self.stages
        return made


def _noting_equation(walk: Any, eqn: core.JaxprEqn, operands: Any) -> int:
    _NotingBuilder.now = stage(eqn)
    return _EQUATION(walk, eqn, operands)


def _noting_contraction(program: Program) -> Program:
    """Contract, and give each operation the stage of the one that it was made from."""
    stages, order = _STAGES_OF[id(program.operations)], iter(program.needed())

    def fused(*operation: Any) -> int | None:
        _NotingBuilder.now = stages[next(order)]
        return _FUSED(*operation)

    with mock.patch.object(builder, "_fuse", fused):
        return builder.contract_to_fma(program)


def stage(eqn: core.JaxprEqn) -> str:
    """Return the file and function of the stage in which an equation was traced, or of the tick
    itself; "" if unknown.
    """
    traceback: Any = eqn.source_info.traceback
    if traceback is None:
        return ""
    own = [frame for frame in traceback.frames if "ravenjax" in PurePath(frame.file_name).parts]
    own = [frame for frame in own if "engines" not in PurePath(frame.file_name).parts]
    inside = [frame for frame in own if not STAGES.isdisjoint(PurePath(frame.file_name).parts)]
    outermost = (inside or own)[-1:]  # innermost frames come first
    return "".join(f"{PurePath(f.file_name).stem}.{f.function_name}" for f in outermost)


def main() -> None:
    """Print the stages, the most expensive first."""
    found = count(Workload(1000))
    rows = [
        (found.lane.get(n, 0), found.shared.get(n, 0), n) for n in {**found.lane, **found.shared}
    ]
    print(f"{found.per_lane:6} in each run, {sum(found.shared.values()):6} shared by runs: all")
    for lane, shared, name in sorted(rows, reverse=True):
        print(f"{lane:6} in each run, {shared:6} shared by runs: {name}")


if __name__ == "__main__":
    main()
