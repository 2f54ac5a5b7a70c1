"""The table of a result folder as a page takes it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd

from ravenjax.analyses.explorer import words
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.store import schema
from ravenjax.store.access.results import Results
from ravenjax.store.manifest import Manifest

MOST = 20_000
"""Rows of a table that go into a page, the first of them."""
_FURTHER = r"fault0_(trigger|every_ms)|fault[1-9]\d*_site"
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
    """JSON: folder (its name), cue (number of the set that counts), runs (of the table), rows (of
    them, MOST at most), columns: name -> list, and evading: see `_evading`. Left out are runs that
    a page cannot ask for, see `_asked`."""
    cue, names = record.verdict_cue, [column.name for column in schema.columns(record.shape)]
    columns = {
        "run_id": "run_id",
        "index": "index",
        "group": "group",
        **{name: f"fault0_{name}" for name in FAULT},
        **{name: name for name in MEASURES},
        "cue_ms": f"cue{cue}_first_ms",
        **{name: name for name in names if name.startswith("param:")},
    }
    columns = {name: column for name, column in columns.items() if column in names}
    further = [name for name in names if re.fullmatch(_FURTHER, name)]
    frame = Results(record.shape, folder).frame([*columns.values(), *further])
    first = frame.loc[_asked(frame)].head(MOST)
    return {
        "folder": folder.name,
        "cue": cue,
        "runs": len(frame),
        "rows": len(first),
        "evading": _evading(folder, record),
        "columns": {name: _plain(first[column]) for name, column in columns.items()},
    }


def _evading(folder: Path, record: Manifest) -> dict[str, float]:
    """k of n distinct faults evade, as the report counts them; low and high are NaN where faults
    were enumerated.
    """
    runs = Runs.open(folder, record)
    try:
        return tables.headline(runs, record)["evaded"]._asdict()
    finally:
        runs.close()


def _asked(frame: pd.DataFrame) -> pd.Series:
    """Which runs a page can ask for: with one fault or none, of an effect that it offers, in one
    window of time.
    """
    sites = frame.filter(regex=r"^fault\d+_site$").astype(str)
    if sites.empty:
        return pd.Series(True, index=frame.index)
    plain = frame["fault0_trigger"].astype(str).eq("time") & frame["fault0_every_ms"].eq(0)
    offered = ~frame["fault0_effect"].astype(str).isin(words.UNASKED)
    return sites.drop(columns="fault0_site").eq("").all(axis=1) & (
        sites["fault0_site"].eq("") | plain & offered
    )


def _plain(column: pd.Series) -> list[Any]:
    if column.dtype.kind in "fiub":
        return [None if value != value else value for value in column.tolist()]
    return column.astype(str).tolist()
