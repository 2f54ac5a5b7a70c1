"""How many operations a tick takes, and in which stage they arise: what to shorten first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from jax.extend import core

from ravenjax.ir.regions import Region, arrange, flat
from ravenjax.ir.time_loop import Split

_FREE = ("neg", "bitcast", "constant", "input")
"""Operations that become part of others, or none."""
STAGES = frozenset(("stages", "plant", "console"))
"""Folders of a robot, or of any, whose files are stages."""


def stage(eqn: core.JaxprEqn) -> str:
    """The file and function of a stage in which an equation was traced, of the tick itself otherwise; "" if unknown."""
    traceback: Any = eqn.source_info.traceback
    if traceback is None:
        return ""
    own = [frame for frame in traceback.frames if "ravenjax" in PurePath(frame.file_name).parts]
    own = [frame for frame in own if "engines" not in PurePath(frame.file_name).parts]
    inside = [frame for frame in own if not STAGES.isdisjoint(PurePath(frame.file_name).parts)]
    outermost = (inside or own)[-1:]  # innermost frames come first
    return "".join(f"{PurePath(f.file_name).stem}.{f.function_name}" for f in outermost)


def by_stage(split: Split) -> Mapping[str, Counter[str]]:
    """Operations by stage of the "lane" part and of the "shared" part; those without cost are left out.

    "rare" are those of a lane that only some ticks need; they are not counted in "lane".
    """
    step, loop = split.loop.step, split.loop
    leaving = [*(step.outputs[k] for k in split.lane_state), *step.outputs[loop.states :]]
    of_groups = [*split.row, *(step.outputs[k] for k in split.shared_state)]
    lane = arrange(step.operations, split.lane, leaving)
    shared = arrange(step.operations, split.shared, of_groups)
    parts = {
        "lane": [i for i in lane if not isinstance(i, Region)],
        "shared": [i for i in shared if not isinstance(i, Region)],
        "rare": list(flat(item for item in lane if isinstance(item, Region))),
    }
    return {
        part: Counter(step.origins[i] for i in numbers if step.operations[i].name not in _FREE)
        for part, numbers in parts.items()
    }
