"""Repeats published experiments and runs the project's own studies, and compares published results
with predictions.

`ravenjax reproduce NAME` runs one study.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from ravenjax.errors import UserError, suggest_name

if TYPE_CHECKING:
    from studies.study import Study

NAMES = {
    "seed_fault_free": "seed.fault_free",
    "seed_burst": "seed.burst",
    "dsn16_a": "dsn16.operator_packets",
    "dsn16_b": "dsn16.motor_commands",
    "dsn16_thresholds": "dsn16.thresholds",
    "dsn16_model": "dsn16.model",
    "mechanics": "mechanics",
    "healthy_robot": "healthy_robot",
    "safecomp45": "hazards.safecomp45",
    "hazard_library": "hazards.library",
    "reacting_operator": "reacting_operator",
    "uncertain_robot": "uncertain_robot",
    "detectors": "detectors",
    "haptic_cue": "haptic_cue",
    "false_cues": "false_cues",
    "hand": "hand",
}
"""The module of each study, in the order in which studies are listed. Each module defines STUDY."""


def find(name: str) -> Study:
    """Return the study with a name. Raises UserError."""
    if name not in NAMES:
        raise UserError(
            f"unknown study {name!r}, expected one of {', '.join(NAMES)}{suggest_name(name, NAMES)}"
        )
    return importlib.import_module(f"studies.{NAMES[name]}").STUDY
