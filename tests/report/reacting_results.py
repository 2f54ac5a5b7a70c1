"""Synthetic results in which each fault was run once with nobody who reacts and once with each
of two reactions.
"""

import numpy as np
import pandas as pd
import synthetic_results as synthetic

from ravenjax.store import schema
from ravenjax.store.manifest import Manifest

ACTIONS = (0, 1, 3)
SHAPE = schema.Shape(
    arms=("gold",),
    slots=1,
    cues=len(synthetic.CUES),
    checks=synthetic.CHECKS,
    parameters=("plant.friction_scale", "reaction.action"),
    stages=("reaction",),
    detectors=tuple(len(detector.thresholds) for detector in synthetic.DETECTORS),
)


def frame(faults: int = 200, seed: int = 0) -> pd.DataFrame:
    """len(ACTIONS) rows a fault; who reacts to the cue lets the tip go half as far by itself, and
    one in ten unintended motions is avoided."""
    alone = synthetic.frame(faults, seed)
    parts = []
    for number, action in enumerate(ACTIONS):
        part = alone.copy()
        part["param:reaction.action"] = float(action)
        part["index"] = part["index"] + number * faults
        part["run_id"] = [f"{action}{one[1:]}" for one in part["run_id"]]
        acted = (action > 0) & (part["cue0_first_ms"] >= 0)
        part["reaction_ms"] = np.where(acted, part["cue0_first_ms"] + 250, -1)
        part["golden_reaction_ms"] = -1
        for name in ("unintended_mm", "unintended_off_mm"):
            part[name] = np.where(acted, part[name] / 2, part[name])
        avoided = acted & (part["pair"] % 10 == 0)
        part["unintended_first_ms"] = np.where(avoided, -1, part["unintended_first_ms"])
        part["pedal_down_ms"] = np.where(
            acted & (action == 1), part["reaction_ms"], part["pedal_down_ms"]
        )
        parts.append(part)
    table = synthetic.judged(pd.concat(parts, ignore_index=True))
    return table[[column.name for column in schema.table_columns(SHAPE)]]


def manifest(runs: int, **changes: object) -> Manifest:
    """Its manifest, without parts."""
    config = {
        "name": "synthetic",
        "reaction": {"action": "release"},
        "cross": {"reaction.action": list(ACTIONS)},
    }
    return synthetic.manifest(runs, shape=SHAPE, config=config, **changes)
