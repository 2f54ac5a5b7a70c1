"""Rates the severity of each run, 0 to 5, on the scale of the risk tables, from the result table
alone.
"""

import numpy as np
import pandas as pd

from ravenjax.outcomes.verdict import LIMIT_MM, TOLD, beyond_golden
from studies.hazards import classes

SCALE = (
    "nothing",
    "a check spoke or limited a command, and nothing else happened",
    "pause or restart: the robot stopped or stood, and the fault ends by itself",
    (
        "conversion or reschedule: the robot stopped or stood, and a restart would meet the fault"
        " again"
    ),
    "injury-capable motion with an alarm of a check, or the haptic cue",
    "injury-capable motion without any alarm",
)
"""Meaning of each severity, by number.

This is an ordinal scale of this project: no source weighs a stop against an injury.
"""

INJURY = 4
"""Lowest severity of a motion that could injure."""

DEPTH_MM = 1.0
"""Depth in tissue beyond the golden run's that could injure: surgeons accept no sudden 1 mm (DSN
2016).
"""

UNTIL_END = -1
"""`fault<k>_duration_ms` of a fault that lasts until the end of the run."""

COLUMNS = (
    *classes.COLUMNS,
    "tissue_depth_mm",
    "golden_tissue_depth_mm",
    "fault0_duration_ms",
    "fault0_every_ms",
)
"""Columns of the result table that severities need, beside those of the cue and of other slots."""


def rate_severity(
    frame: pd.DataFrame, cue: int | None = 0, limit_mm: float = LIMIT_MM
) -> pd.Series:
    """Return the severity of each row of a result table, Int64, missing for failed runs.

    cue: index of the haptic set that counts as an alarm; None: a robot without a cue. limit_mm:
    limit of an unintended motion. Raises KeyError for a missing column.
    """
    if missing := [name for name in COLUMNS if name not in frame]:
        raise KeyError(
            f"severities need the columns {', '.join(COLUMNS)}; the table lacks"
            f" {', '.join(missing)}"
        )
    flags = classes.classify_rows(frame, limit_mm)
    unavailable = flags["stop"] | flags["unresponsive"]
    alarmed = frame["response"].astype(str).isin(TOLD)
    if cue is not None:
        alarmed |= (
            beyond_golden(frame[f"cue{cue}_first_ms"], frame[f"golden_cue{cue}_first_ms"]) >= 0
        )
    harmful = injury_capable(frame, flags)
    number = np.select(
        [
            harmful & ~alarmed,
            harmful,
            unavailable & has_lasting_fault(frame),
            unavailable,
            flags["message"],
        ],
        [5, 4, 3, 2, 1],
        0,
    )
    return pd.Series(number, frame.index, "Int64", name="severity").where(frame["failed"] == "")


def injury_capable(frame: pd.DataFrame, flags: pd.DataFrame | None = None) -> pd.Series:
    """Return which runs moved the instrument so that it could injure.

    These are runs with a jump, an unintended motion beyond the limit, or a tip more than DEPTH_MM
    deeper than the golden run's. flags: the result of `classes.classify_rows`, if it is already
    available.
    """
    flags = classes.classify_rows(frame) if flags is None else flags
    deeper_mm = frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"]
    deeper = (deeper_mm > DEPTH_MM) & (frame["failed"] == "")
    return pd.Series(flags[["jump", "displaced"]].any(axis=1) | deeper, frame.index)


def has_lasting_fault(frame: pd.DataFrame) -> pd.Series:
    """Return which runs have a fault that does not end: it lasts until the run's end, or
    repeats.
    """
    lasts = pd.Series(False, frame.index)
    for name in (name for name in frame if name.startswith("fault") and name.endswith("_site")):
        slot = name.removesuffix("_site")
        endless = (frame[f"{slot}_duration_ms"] == UNTIL_END) | (frame[f"{slot}_every_ms"] > 0)
        lasts |= (frame[name].astype(str) != "") & endless
    return lasts
