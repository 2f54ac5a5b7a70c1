"""Counts operations of the timed tick by stage, as the code-generating engines compute them, to
find the stages worth optimising.

    python analysis/engines/tick_operations.py
"""

import dataclasses
import sys
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from jax.extend import core

sys.path.append(str(Path(__file__).resolve().parents[1]))

from bench.engines import by_stage
from bench.workload import Workload
from ravenjax.engines import traced
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
    program = workload.program
    trace = traced.trace_tick(program, workload.golden_runs(1), workload.motion, stage)
    parts = by_stage(split_lanes(trace.without_signals(), len(program.varied), True))
    return Operations(
        *(
            {name or "tick.glue": n for name, n in parts[k].most_common()}
            for k in ("lane", "shared")
        )
    )


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
