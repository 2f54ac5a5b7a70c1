"""Rows of a result table by hand: a run in which nothing happened, and what is said to differ."""

from typing import Any

import pandas as pd

QUIET: dict[str, Any] = {
    "group": "library/B24",
    "failed": "",
    "response": "silent",
    "response_cause": "",
    "activated": True,
    "fault0_site": "usb_out",
    "fault0_value": 200.0,
    "fault0_duration_ms": 64,
    "fault0_every_ms": 0,
    "cue0_first_ms": -1,
    "golden_cue0_first_ms": -1,
    "jump_text": False,
    "jump_tip": False,
    "unintended_mm": 0.2,
    "unintended_off_mm": 0.1,
    "idle_ms": 0,
    "pedal_down_ms": 2800,
    "restart_ms": -1,
    "golden_pedal_down_ms": 2800,
    "peak_golden_deviation_mm": 0.2,
    "largest_step_mm": 0.04,
    "tip_path_mm": 60.0,
    "golden_tip_path_mm": 60.0,
    "tissue_depth_mm": 0.0,
    "golden_tissue_depth_mm": 0.0,
}


def frame(*rows: dict[str, Any]) -> pd.DataFrame:
    """One row a run; each says what differs from QUIET."""
    return pd.DataFrame([{**QUIET, **row} for row in rows])
