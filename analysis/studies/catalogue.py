"""The studies by name; each module is imported when it is asked for."""

from __future__ import annotations

import importlib

from ravenjax.errors import UserError, suggestion
from studies.framework.study import Study

NAMES = {
    "seed_fault_free": "seed.fault_free.scales",
    "seed_burst": "seed.burst.constants",
    "dsn16_a": "dsn16.operator_packets",
    "dsn16_b": "dsn16.motor_commands",
    "dsn16_thresholds": "dsn16.thresholds",
    "dsn16_model": "dsn16.model",
    "mechanics": "mechanics.robot",
    "healthy_robot": "healthy.robot",
    "safecomp45": "hazards.safecomp45",
    "hazard_library": "hazards.library",
    "reacting_operator": "reaction.operator",
    "uncertain_robot": "uncertainty.robot",
    "detectors": "detection.comparison",
    "haptic_cue": "haptics.cue",
    "hand": "hand.force",
}
"""The module of each, in the order in which they are listed."""


def find(name: str) -> Study:
    """The study of that name. Raises UserError."""
    if name not in NAMES:
        raise UserError(
            f"unknown study {name!r}, expected one of {', '.join(NAMES)}{suggestion(name, NAMES)}"
        )
    return importlib.import_module(f"studies.{NAMES[name]}").STUDY
