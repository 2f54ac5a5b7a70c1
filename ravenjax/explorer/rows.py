"""The table of a result folder as a page takes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from ravenjax.store.access.results import Results
from ravenjax.store.manifest import Manifest

MOST = 20_000
"""Rows of a table that go into a page, the first of them."""
FAULT = ("site", "arm", "channel", "effect", "value", "start_ms", "duration_ms")
MEASURES = (
    "response",
    "hazard",
    "verdict",
    "failed",
    "first_active_ms",
    "told_ms",
    "unintended_mm",
    "unintended_first_ms",
    "loss_first_ms",
    "false_report_first_ms",
    "peak_golden_deviation_mm",
)
"""Columns of the result table that a page shows beside a run's fault and parameters."""


def table(folder: Path, record: Manifest) -> dict[str, Any]:
    """JSON: folder (its name), cue (number of the set that counts), runs (of the table), rows (of them, with one fault
    or none, MOST at most), and columns: name -> list."""
    frame = Results(record.shape, folder).frame()
    several = frame["fault1_site"].astype(str) != "" if "fault1_site" in frame else pd.Series(False, index=frame.index)
    first = frame.loc[~several].head(MOST)
    cue = record.verdict_cue
    columns = {
        "run_id": "run_id",
        "index": "index",
        "group": "group",
        **{name: f"fault0_{name}" for name in FAULT},
        **{name: name for name in MEASURES},
        "cue_ms": f"cue{cue}_first_ms",
        **{name: name for name in frame.columns if str(name).startswith("param:")},
    }
    return {
        "folder": folder.name,
        "cue": cue,
        "runs": len(frame),
        "rows": len(first),
        "columns": {name: _plain(first[column]) for name, column in columns.items() if column in first},
    }


def _plain(column: pd.Series) -> list[Any]:
    if column.dtype.kind in "fiub":
        return [None if value != value else value for value in column.tolist()]
    return column.astype(str).tolist()
