"""Lists the kinds of detectors.

A detector computes a score from signals and changes nothing. `stages.detectors` has the code.
"""

import dataclasses
from typing import Literal

from ravenjax import resources
from ravenjax.vocabulary.parts import OwnSource

BuiltInKind = Literal["steps", "derivative_sum", "tip_error", "overdrive"]
DetectorKind = BuiltInKind | Literal["own"]
Fusion = Literal["all", "two", "any", "mpos", "mvel", "jpos"]

MEANINGS: dict[DetectorKind, str] = resources.read_tables(__file__, "detectors.toml")  # pyright: ignore[reportAssignmentType]
"""What the score of each kind of detector measures."""


@dataclasses.dataclass(frozen=True)
class DetectorUse:
    """One detector of a campaign; static."""

    kind: DetectorKind
    fusion: Fusion = "all"  # kind `steps`: which of the three steps must exceed the threshold
    consecutive: int = 1  # number of consecutive ticks above the threshold before an alarm
    thresholds: int = 1  # number of thresholds, all evaluated in the same run
    part: OwnSource | None = None  # kind `own`: the user's file
    stops: bool = False  # an alarm at the first threshold triggers the E-stop
