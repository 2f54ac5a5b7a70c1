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
        "steps of motor position, motor velocity and joint position, predicted by a model and"
        " divided by their thresholds"
    ),
    "derivative_sum": "sum of the derivatives of link and motor positions",
    "tip_error": "distance of the tip from the nominal model, mm",
    "overdrive": "command divided by the limit at which it is clipped",
    "own": "score of the user's file",
}
"""What the score of each kind of detector measures."""


@dataclasses.dataclass(frozen=True)
class DetectorUse:
    """One detector of a campaign; static."""

    kind: DetectorKind
    fusion: Fusion = "all"  # kind `steps`: which of the three steps must exceed the threshold
    consecutive: int = 1  # number of consecutive ms above the threshold before an alarm
    thresholds: int = 1  # number of thresholds, all evaluated in the same run
    part: OwnSource | None = None  # kind `own`: the user's file
    stops: bool = False  # an alarm at the first threshold triggers the E-stop
