"""Classifies each run in the terms of a hazard analysis (`data/terms.toml`), and rates its severity
on the scale of the risk tables, from the result table alone.

A run may have several classes. A run without any other class has class `none`. A failed run has no
class.

- `jump`: the true tip moved more than 0.1 mm in each of two successive ticks, and the golden run
  did not. This is the rule of the published code, applied to the true tip instead of the reported
  tip. Or the true tip moved more than 1 mm within 2 ms (the rule of the published text).
- `stop`: a check stopped the robot. Or the control software left pedal-down, or was in a software
  E-stop, for more than 0.2 s in total while the golden run was in pedal-down.
- `unresponsive`: no stop, but the robot stood still for 0.2 s in total while the golden run moved.
- `displaced`: no jump, but the tip made an unintended motion of more than 3 mm, live or not.
- `message`: no stop, but a check raised an alarm, limited a command or dropped a packet. The
  published experiments read these events from logs.

A robot that only stops while the golden run continues is therefore not displaced. A robot that
coasts by 3 mm after its stop is displaced.
"""

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import HALT_MS, LIMIT_MM, TOLD, beyond_golden

IDLE_MS = 200
"""Time for which a robot must stand still to be noticed: the largest tolerated visual delay."""
SEVERITIES = (
    "nothing",
    "a check raised an alarm or limited a command, and nothing else happened",
    "pause or restart: the robot stopped or stood still, and the fault ends by itself",
    "conversion or reschedule: as before, but a restart would meet the fault again",
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


def classify_rows(frame: pd.DataFrame, limit_mm: float = LIMIT_MM) -> pd.DataFrame:
    """Return which classes each row of a result table has: bool [rows, classes]. Columns have the
    order of terms.toml, mildest first.
    """
    valid, response = frame["failed"] == "", frame["response"].astype(str)
    absent_ms = frame["golden_pedal_down_ms"] - frame["pedal_down_ms"]
    stop = (response == "stopped") | ((absent_ms > HALT_MS) & (frame["pedal_down_ms"] > 0))
    jump = frame["jump_tip"].astype(bool) | frame["jump_text"].astype(bool)
    moved_mm = frame[["unintended_mm", "unintended_off_mm"]].max(axis=1)
    flags = pd.DataFrame(
        {
            "none": False,
            "message": valid & ~stop & response.isin(("flagged", "limited")),
            "stop": valid & stop,
            "unresponsive": valid & ~stop & (frame["idle_ms"] >= IDLE_MS),
            "displaced": valid & ~jump & (moved_mm > limit_mm),
            "jump": valid & jump,
        },
        index=frame.index,
    )
    flags["none"] = valid & ~flags.any(axis=1)
    return flags


def rate_severity(frame: pd.DataFrame) -> pd.Series:
    """Return the severity of each row of a result table, Int64, missing for failed runs."""
    flags, harmful = classify_rows(frame), injury_capable(frame)
    unavailable, lasting = flags["stop"] | flags["unresponsive"], pd.Series(False, frame.index)
    cue = beyond_golden(frame["cue0_first_ms"], frame["golden_cue0_first_ms"]) >= 0
    alarmed = frame["response"].astype(str).isin(TOLD) | cue
    for slot in frame.filter(regex=r"^fault\d+_site$").columns.str.removesuffix("_site"):
        endless = (frame[f"{slot}_duration_ms"] == UNTIL_END) | (frame[f"{slot}_every_ms"] > 0)
        lasting |= (frame[f"{slot}_site"].astype(str) != "") & endless
    conditions = [harmful & ~alarmed, harmful, unavailable & lasting, unavailable, flags["message"]]
    number = np.select(conditions, [5, 4, 3, 2, 1], 0)
    return pd.Series(number, frame.index, "Int64", name="severity").where(frame["failed"] == "")


def injury_capable(frame: pd.DataFrame) -> pd.Series:
    """Return which runs have a jump, an unintended motion, or a tip deeper by DEPTH_MM."""
    flags = classify_rows(frame)
    deeper_mm = frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"]
    return flags["jump"] | flags["displaced"] | ((deeper_mm > DEPTH_MM) & (frame["failed"] == ""))
