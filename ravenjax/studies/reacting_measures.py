"""What counts as harm where the operator may react, and for which reaction each measure is fair.

A measure compares the robot with something, and a reaction may change that something, too:

- *Off the model*: the tip against the nominal model, while the robot is live. Who slows down takes the model along, so
  what is left is the fault's. Who has lifted the pedal is no longer live, so an arm that runs on is not seen. Who
  corrects pushes the model away by as much as the fault had pushed the robot: no correction could ever look good.
- *Strayed*: the tip against the fault-free twin's, and against where standing would have left it. It sees an arm that
  runs on after the pedal was lifted, and a correction brings it back to where the operator meant to be. Slow hands stay
  behind the twin on purpose: for them it means nothing.
- *Leapt* and *deeper in the tissue* are of the tip alone, and fair for everybody.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import classes, severity

RELEASE, SLOW, CORRECT = 1, 2, 3
"""Actions, as in report.facts.ACTIONS."""

SIZES_MM = (3.0, 5.0, 10.0, 20.0)
"""Sizes of harm. 3 mm is where the published cue fires: it is reached when the operator is told, not before."""


class Measure(NamedTuple):
    """One kind of harm."""

    name: str
    hits: Callable[[pd.DataFrame, pd.DataFrame], np.ndarray]  # result table, its facts -> bool [runs]
    fair: tuple[int, ...]  # actions for which it means the same as without one


def live(size_mm: float) -> Measure:
    """Off the nominal model by more than that, while the robot is live."""

    def hits(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
        here, twin = frame["peak_live_deviation_mm"], frame["twin_peak_live_deviation_mm"]
        return ((here > size_mm) & ~(twin > size_mm)).to_numpy()

    return Measure(f"off the model by more than {size_mm:g} mm, live", hits, (RELEASE, SLOW))


def stray(size_mm: float) -> Measure:
    """Strayed by more than that."""
    return Measure(
        f"strayed by more than {size_mm:g} mm",
        lambda frame, facts: (frame["stray_mm"] > size_mm).to_numpy(),
        (RELEASE, CORRECT),
    )


def _leapt(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
    return classes.evidence(frame)["leapt"].to_numpy()


def _deeper(frame: pd.DataFrame, facts: pd.DataFrame) -> np.ndarray:
    return ((frame["tissue_depth_mm"] - frame["twin_tissue_depth_mm"]) > severity.DEPTH_MM).to_numpy()


LEAPT = Measure("jump of the true tip", _leapt, (RELEASE, SLOW, CORRECT))
DEEPER = Measure(
    f"more than {severity.DEPTH_MM:g} mm deeper in the tissue than the twin", _deeper, (RELEASE, SLOW, CORRECT)
)
INJURY = Measure(
    "injury-capable motion (jump, stray of 3 mm, or deeper)",
    lambda frame, facts: severity.injury_capable(frame).to_numpy(),
    (RELEASE, CORRECT),
)
HARM = Measure(
    "harm as in the report (3 mm off the model, or a jump)", lambda _, facts: facts["harm"].to_numpy(), (1, 2)
)

MEASURES = (INJURY, HARM, *map(stray, SIZES_MM), *map(live, SIZES_MM), LEAPT, DEEPER)
