"""Classifies each run in the terms of a hazard analysis (`data/terms.toml`), from the result table
alone.

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

import pandas as pd

from ravenjax.outcomes.verdict import HALT_MS, LIMIT_MM

CLASSES = ("none", "message", "stop", "unresponsive", "displaced", "jump")
"""Classes in the order of terms.toml, mildest first."""

IDLE_MS = 200
"""Time for which a robot must stand still to be noticed: the largest tolerated visual delay."""


def classify_rows(frame: pd.DataFrame, limit_mm: float = LIMIT_MM) -> pd.DataFrame:
    """Return which classes each row of a result table has: bool [rows, CLASSES]."""
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
