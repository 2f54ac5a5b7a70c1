"""The studies by name; each module is imported when it is asked for."""

from __future__ import annotations

import importlib

from ravenjax.errors import UserError, suggestion
from ravenjax.studies.study import Study

NAMES = (
    "seed_fault_free",
    "seed_burst",
    "dsn16_a",
    "dsn16_b",
    "dsn16_thresholds",
    "dsn16_model",
    "safecomp45",
    "hazard_library",
    "reacting_operator",
    "uncertain_robot",
    "detectors",
    "haptic_cue",
)
"""In the order in which they are listed."""


def find(name: str) -> Study:
    """The study of that name. Raises UserError."""
    if name not in NAMES:
        raise UserError(f"unknown study {name!r}, expected one of {', '.join(NAMES)}{suggestion(name, NAMES)}")
    return importlib.import_module(f"ravenjax.studies.{name}").STUDY
