"""Rates the severity of each run, 0 to 5, on the scale of the risk tables, from the result table
alone.
"""

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import TOLD, beyond_golden
from studies.hazards import classes

SCALE = (
    "nothing",
    "a check spoke or limited a command, and nothing else happened",
    "pause or restart: the robot stopped or stood, and the fault ends by itself",
    "conversion or reschedule: the same, and a restart would meet the fault again",
    "injury-capable motion with an alarm of a check, or the haptic cue",
    "injury-capable motion without any alarm",
)
"""Meaning of each severity: an ordinal scale of this project."""
INJURY = 4
"""Lowest severity of a motion that could injure."""
DEPTH_MM = 1.0
"""Depth beyond the golden run's that could injure: surgeons accept no sudden 1 mm (DSN 2016)."""
UNTIL_END = -1
"""`fault<k>_duration_ms` of a fault that lasts until the end of the run."""


def rate_severity(frame: pd.DataFrame) -> pd.Series:
    """Return the severity of each row of a result table, Int64, missing for failed runs."""
    flags = classes.classify_rows(frame)
    unavailable, harmful = flags["stop"] | flags["unresponsive"], injury_capable(frame)
    cue = beyond_golden(frame["cue0_first_ms"], frame["golden_cue0_first_ms"]) >= 0
    alarmed = frame["response"].astype(str).isin(TOLD) | cue
    lasting = unavailable & has_lasting_fault(frame)
    conditions = [harmful & ~alarmed, harmful, lasting, unavailable, flags["message"]]
    number = np.select(conditions, [5, 4, 3, 2, 1], 0)
    return pd.Series(number, frame.index, "Int64", name="severity").where(frame["failed"] == "")


def injury_capable(frame: pd.DataFrame) -> pd.Series:
    """Return which runs have a jump, an unintended motion, or a tip deeper by DEPTH_MM."""
    flags = classes.classify_rows(frame)
    deeper_mm = frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"]
    deeper = (deeper_mm > DEPTH_MM) & (frame["failed"] == "")
    return flags["jump"] | flags["displaced"] | deeper


def has_lasting_fault(frame: pd.DataFrame) -> pd.Series:
    """Return which runs have a fault that lasts until the end of the run, or repeats."""
    lasts = pd.Series(False, frame.index)
    for site in frame.filter(regex=r"^fault\d+_site$"):
        slot = site.removesuffix("_site")
        endless = (frame[f"{slot}_duration_ms"] == UNTIL_END) | (frame[f"{slot}_every_ms"] > 0)
        lasts |= (frame[site].astype(str) != "") & endless
    return lasts
