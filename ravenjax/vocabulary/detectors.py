"""Detectors: observers that are scored and change nothing. How a score is made is in
`ravenjax.stages.detectors`.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

from ravenjax.vocabulary.parts import OwnSource

BuiltInKind = Literal["steps", "derivative_sum", "tip_error", "overdrive"]
DetectorKind = BuiltInKind | Literal["own"]
Fusion = Literal["all", "two", "any", "mpos", "mvel", "jpos"]

MEANINGS: dict[DetectorKind, str] = {
    "steps": (
        "of motor position, motor velocity and joint position over their thresholds, model-based"
    ),
    "derivative_sum": "of link and motor derivatives",
    "tip_error": "distance from the nominal model, mm",
    "overdrive": "command over its clip limit",
    "own": "as a file says, a detector of one's own",
}
"""What the score of each kind is."""


@dataclasses.dataclass(frozen=True)
class DetectorUse:
    """One detector of a campaign; static."""

    kind: DetectorKind
    fusion: Fusion = "all"  # of `steps`: which of the three must be over
    consecutive: int = 1  # milliseconds in a row above the threshold that make an alarm
    thresholds: int = 1  # how many are evaluated side by side
    part: OwnSource | None = None  # of `own`
    stops: bool = False  # an alarm at its first threshold presses the E-stop
