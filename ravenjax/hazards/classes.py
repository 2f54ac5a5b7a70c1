"""What became of each run in the words of a hazard analysis (`data/terms.toml`), from the result
table alone.

Several classes can hold at once. A run that has no other is of class `none`; a run that failed has
none at all.

- `jump`: the true tip leapt: over 0.1 mm in each of two ticks in a row, its golden run not (the
  published code's rule, on the tip itself rather than on what encoders tell of it), or over 1 mm
  within 2 ms (the published text's rule).
- `stop`: a check stopped the robot; or its control software, once in pedal-down, was out of it or
  in a software E-stop for more than 0.2 s in all, while its golden run was in pedal-down.
- `unresponsive`: no stop; the robot stood, or had never started, for 0.2 s in all while its golden
  run moved.
- `displaced`: no jump; the tip made an unintended motion of more than 3 mm, live or not.
- `message`: no stop, but a check acted. It warned a person, limited a command or dropped a packet.
  The published experiments read these events from logs.

So a robot that merely stops, while its golden run goes on, is not displaced; one that coasts by 3
mm after its stop is.
"""

from __future__ import annotations

import pandas as pd

from ravenjax.outcomes.verdict import HALT_MS, LIMIT_MM

CLASSES = ("none", "message", "stop", "unresponsive", "displaced", "jump")
"""In the order of terms.toml, mildest first."""

IDLE_MS = 200
"""A robot that stands so long is noticed: the largest visual delay that operators put up with is
150 to 200 ms.
"""

COLUMNS = (
    "failed",
    "response",
    "jump_text",
    "jump_tip",
    "unintended_mm",
    "unintended_off_mm",
    "idle_ms",
    "pedal_down_ms",
    "golden_pedal_down_ms",
)
"""Columns of the result table that classes are made of."""


def classify(frame: pd.DataFrame, limit_mm: float = LIMIT_MM) -> pd.DataFrame:
    """Which classes each row of a result table has: bool [rows, CLASSES], index kept.

    limit_mm: how far is `displaced`. KeyError names a column that the table lacks.
    """
    signs = evidence(frame, limit_mm)
    valid, response = frame["failed"] == "", frame["response"].astype(str)
    stop = valid & ((response == "stopped") | signs["halted"])
    jump = valid & signs["leapt"]
    flags = pd.DataFrame(
        {
            "none": False,
            "message": valid & ~stop & response.isin(("flagged", "limited")),
            "stop": stop,
            "unresponsive": valid & ~stop & signs["idle"],
            "displaced": valid & ~jump & signs["strayed"],
            "jump": jump,
        },
        index=frame.index,
    )
    flags["none"] = valid & ~flags.any(axis=1)
    return flags


def evidence(frame: pd.DataFrame, limit_mm: float = LIMIT_MM) -> pd.DataFrame:
    """The columns leapt, strayed, idle and halted (bool), from which classes follow. KeyError as in
    `classify`.
    """
    if missing := [name for name in COLUMNS if name not in frame]:
        raise KeyError(
            f"classes of outcomes need the columns {', '.join(COLUMNS)}; the table lacks"
            f" {', '.join(missing)}"
        )
    absent_ms = frame["golden_pedal_down_ms"] - frame["pedal_down_ms"]
    return pd.DataFrame(
        {
            "leapt": frame["jump_tip"].astype(bool) | frame["jump_text"].astype(bool),
            "strayed": frame[["unintended_mm", "unintended_off_mm"]].max(axis=1) > limit_mm,
            "idle": frame["idle_ms"] >= IDLE_MS,
            "halted": (absent_ms > HALT_MS) & (frame["pedal_down_ms"] > 0),
        }
    )
