"""Lists the kinds of detectors. A detector computes a score from signals and changes nothing.

`ravenjax.stages.detectors` computes the scores.
"""

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
    "own": "as the user's file defines it",
}
"""What the score of each kind of detector measures."""


@dataclasses.dataclass(frozen=True)
class DetectorUse:
    """One detector of a campaign; static."""

    kind: DetectorKind
    fusion: Fusion = "all"  # kind `steps`: which of the three steps must be over the threshold
    consecutive: int = 1  # milliseconds in a row above the threshold before an alarm
    thresholds: int = 1  # number of thresholds that are evaluated side by side
    part: OwnSource | None = None  # kind `own`: the user's file
    stops: bool = False  # an alarm at its first threshold triggers the E-stop
