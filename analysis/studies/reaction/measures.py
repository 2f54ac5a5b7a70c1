"""What is counted where the operator may react, and for which reaction each measure is fair.

A measure compares the robot with something, and a reaction may change that something, too:

- *Unintended motion, live or not*: how far the tip went by itself (`report`: `pairs.EXCURSION`). It
  sees an arm that runs on after the pedal was lifted, and a correction brings the tip back to where
  the operator meant to be. Slow hands stay behind the golden run on purpose: where a fault has put
  the nominal model out, too, they would count as moved.
- *Unintended motion*: the hazard of the report. The same while the robot is live, so that what an
  arm does after the pedal was lifted is not seen.
- *Off the model*: the tip against the nominal model, while the robot is live. Who slows down takes
  the model along, so what is left is the fault's. Who corrects pushes the model away by as much as
  the fault had pushed the robot: no correction could ever look good. A robot that stands while it
  should move counts, too.
- *Jump* and *deeper in the tissue* are of the tip alone, and fair for everybody.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import classes, severity
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report.sections.reaction.pairs import EXCURSION
from ravenjax.vocabulary.reactions import CORRECT, RELEASE, SLOW

SIZES_MM = (LIMIT_MM, 5.0, 10.0, 20.0)
"""Sizes of motion; at the first the published cue fires, too: it is reached when the operator is
told, not before.
"""


class Measure(NamedTuple):
    """One thing that is counted."""

    name: str
    hits: Callable[
        [pd.DataFrame, pd.DataFrame], np.ndarray
    ]  # result table, its facts -> bool [runs]
    fair: tuple[int, ...]  # actions for which it means the same as without one


def excursion(size_mm: float) -> Measure:
    """Unintended motion of more than that, live or not."""
    return Measure(
        f"unintended motion of more than {size_mm:g} mm, live or not",
        lambda frame, facts: (frame[EXCURSION] > size_mm).to_numpy(),
        (RELEASE, CORRECT),
    )


def live(size_mm: float) -> Measure:
    """Off the nominal model by more than that, while the robot is live."""

    def hits(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
        here, golden = frame["peak_live_deviation_mm"], frame["golden_peak_live_deviation_mm"]
        return ((here > size_mm) & ~(golden > size_mm)).to_numpy()

    return Measure(f"off the model by more than {size_mm:g} mm, live", hits, (RELEASE, SLOW))


def _leapt(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
    return classes.evidence(frame)["leapt"].to_numpy()


def _deeper(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
    return (
        (frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"]) > severity.DEPTH_MM
    ).to_numpy()


LEAPT = Measure("jump of the true tip", _leapt, (RELEASE, SLOW, CORRECT))
DEEPER = Measure(
    f"more than {severity.DEPTH_MM:g} mm deeper in the tissue than the golden run",
    _deeper,
    (RELEASE, SLOW, CORRECT),
)
INJURY = Measure(
    f"injury-capable motion (jump, unintended motion of {LIMIT_MM:g} mm live or not, or deeper)",
    lambda frame, facts: severity.injury_capable(frame).to_numpy(),
    (RELEASE, CORRECT),
)
UNINTENDED = Measure(
    f"unintended motion of more than {LIMIT_MM:g} mm, the hazard of the report",
    lambda _, facts: facts["unintended"].to_numpy(bool),
    (RELEASE, CORRECT),
)

MEASURES = (INJURY, UNINTENDED, *map(excursion, SIZES_MM), *map(live, SIZES_MM), LEAPT, DEEPER)
