"""Operations of the timed tick by stage, as the printing engines compute them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from ravenjax.bench.workload import Workload
from ravenjax.engines import operation_count, traced
from ravenjax.ir.time_loop import split


@dataclasses.dataclass(frozen=True)
class Operations:
    """Scalar operations of one tick by stage, without those that only some ticks need; a fused multiply-add is one."""

    lane: Mapping[str, int]  # in every run
    shared: Mapping[str, int]  # once for all runs that share their parameters

    @property
    def per_lane(self) -> int:
        """All in every run."""
        return sum(self.lane.values())

    @property
    def per_group(self) -> int:
        """All that runs share."""
        return sum(self.shared.values())


def count(workload: Workload) -> Operations:
    """Count the operations of the workload's tick."""
    program = workload.program
    trace = traced.trace(program, workload.golden_runs(1), workload.motion, operation_count.stage)
    parts = operation_count.by_stage(
        split(trace.without_signals(), range(len(program.varied)), range(1 + trace.series))
    )
    return Operations(*({name or "tick.glue": n for name, n in parts[k].most_common()} for k in ("lane", "shared")))
