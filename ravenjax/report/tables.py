"""The report's numbers: every rate with its n and Wilson interval, failed runs counted and never dropped."""

from __future__ import annotations

import functools
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.report import wording
from ravenjax.report.facts import OUTCOMES
from ravenjax.stats.intervals import Rate, wilson
from ravenjax.store import schema
from ravenjax.store.manifest import Manifest

WORST = 15
"""Rows of the table of worst silent runs."""


def rate(hits: Any) -> Rate:
    """Wilson rate of truth values."""
    hits = np.asarray(hits, bool)
    return rate_of(int(hits.sum()), len(hits))


@functools.lru_cache(maxsize=10_000)
def rate_of(k: int, n: int) -> Rate:
    """Wilson rate of k in n; the same few counts come again and again in the cells of a page."""
    return wilson(k, n)


def headline(facts: pd.DataFrame) -> dict[str, Any]:
    """Counts of distinct faults: a fault that was run several times counts once, and as evading if it ever did.

    Where some operators react to the cue, all is of the runs in which nobody does.
    """
    facts = facts.loc[facts["plain"]]
    faulty = facts.loc[facts["faulty"]]
    ever = faulty["evaded"].groupby(faulty["distinct"].to_numpy()).any()
    free = facts.loc[~facts["faulty"] & ~facts["failed"]]
    outcomes = faulty["outcome"]
    both = faulty.loc[(faulty["cue_ms"] >= 0) & (faulty["response_ms"] >= 0) & ~faulty["failed"]]
    return {
        "evaded": rate(ever),
        "felt": int((outcomes == "felt").sum()),
        "phantom": int((outcomes == "phantom").sum()),
        "late": int(
            (faulty["haptic"] & (faulty["response"] == "stopped") & (faulty["cue_ms"] > faulty["response_ms"])).sum()
        ),
        "unseen": int((outcomes == "unseen").sum()),
        "runs": len(faulty),
        "repeated": len(faulty) > len(ever),
        "failed": int((outcomes == "failed").sum()),
        "activated": rate(faulty["activated"]),
        "outcomes": {name: rate(outcomes == name) for name in OUTCOMES},
        "cue_first": rate(both["cue_ms"] < both["response_ms"]),
        "same_ms": int((both["cue_ms"] == both["response_ms"]).sum()),
        "lead_ms": float((both["response_ms"] - both["cue_ms"]).median()),
        "false_cue": rate(free["haptic"]),
        "false_response": rate(free["response"] != "silent"),
    }


def verdict_matrix(facts: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows stopped, flagged, silent; cells by haptic and jump, each a rate of all rows of `facts`."""
    rows = []
    for response in schema.RESPONSES:
        mine = facts["response"] == response
        cells = [
            {
                "rate": rate(mine & (facts["haptic"] == haptic) & (facts["jump"] == jump)),
                "evades": response == "silent" and haptic,
                "unseen": response == "silent" and jump and not haptic,
            }
            for haptic in (True, False)
            for jump in (True, False)
        ]
        rows.append({"name": response, "cells": cells, "total": rate(mine)})
    return rows


def matrix_cells(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A verdict matrix cell by cell."""
    names = [(cue, jump) for cue in ("haptic", "no haptic") for jump in ("jump", "no jump")]
    return [
        {"response": row["name"], "cue": cue, "jump": jump, "share": cell["rate"]}
        for row in rows
        for (cue, jump), cell in zip(names, row["cells"], strict=True)
    ]


def group_rows(facts: pd.DataFrame) -> list[dict[str, Any]]:
    """One row per group: its outcomes as rates and its own verdict matrix."""
    rows = []
    for name, part in facts.groupby("group", observed=True):
        rows.append(
            {
                "name": name,
                "n": len(part),
                "faulty": bool(part["faulty"].any()),
                "distinct": part["distinct"].nunique(),
                "outcomes": {key: rate(part["outcome"] == key) for key in OUTCOMES},
                "evaded": rate(part["evaded"]),
                "matrix": verdict_matrix(part),
                "failed": int(part["failed"].to_numpy().sum()),
            }
        )
    return sorted(rows, key=lambda row: (not row["faulty"], -row["evaded"].value))


def delays(facts: pd.DataFrame, event_ms: np.ndarray, end_ms: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Delay of an event after the fault's first effect, for activated valid runs.

    Returns delay (ms; to the end of observation where it never came: a stop or the end of the run), whether it came,
    and how many runs are left out because the event came before the fault did anything.
    """
    chosen = facts["activated"] & ~facts["failed"] & facts["faulty"]
    start, event = facts.loc[chosen, "active_ms"].to_numpy(), event_ms[chosen]
    stop = facts.loc[chosen, "response_ms"].where(facts.loc[chosen, "response"] == "stopped", end_ms).to_numpy()
    early = (event >= 0) & (event < start)
    came = event >= 0
    delay = np.where(came, event, np.maximum(stop, start)) - start
    return delay[~early].astype(float), came[~early], int(early.sum())


def check_rows(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest) -> list[dict[str, Any]]:
    """One row per built-in check: how often it tripped and how close it came in silent runs."""
    chosen = facts["faulty"] & ~facts["failed"]
    silent = chosen & (facts["response"] == "silent")
    rows = []
    for check in manifest.shape.checks:
        first = frame.loc[chosen, f"check_{check}_first_ms"]
        margin = frame.loc[silent, f"check_{check}_margin"].min()
        unit, what = schema.CHECKS.get(check, ("1", ""))
        rows.append(
            {
                "name": check,
                "what": what,
                "tripped": rate(first >= 0),
                "closest": float(margin),
                "unit": "" if unit == "1" else unit,
            }
        )
    return sorted(rows, key=lambda row: -row["tripped"].k)


def cause_rows(frame: pd.DataFrame, facts: pd.DataFrame) -> list[dict[str, Any]]:
    """What the first response of the flagged and stopped runs was."""
    chosen = facts["faulty"] & facts["outcome"].isin(["stopped", "flagged"])
    table = pd.crosstab(frame.loc[chosen, "response_cause"].astype(str), facts.loc[chosen, "outcome"])
    table = table.reindex(columns=["stopped", "flagged"], fill_value=0)
    order = table.sum(axis=1).sort_values(ascending=False).index
    return [{"cause": cause or "not recorded", **table.loc[cause].to_dict()} for cause in order]


def worst_rows(frame: pd.DataFrame, facts: pd.DataFrame, folder: Path) -> list[dict[str, Any]]:
    """The silent faulty runs that moved the instrument farthest from the model, and the command that replays each."""
    silent = facts["faulty"] & ~facts["failed"] & (facts["response"] == "silent")
    farthest = frame.loc[silent, "peak_model_deviation_mm"].sort_values(ascending=False, kind="stable")
    worst = frame.loc[farthest.head(WORST).index]
    return [
        {
            "run_id": row["run_id"],
            "group": row["group"],
            "fault": wording.fault(row),
            "deviation_mm": row["peak_model_deviation_mm"],
            "step_mm": row["largest_step_mm"],
            "depth_mm": row["tissue_depth_mm"],
            "cue_ms": facts.at[index, "cue_ms"] - row["first_active_ms"] if facts.at[index, "cue_ms"] >= 0 else None,
            "verdict": row["verdict"],
            "command": _replay(folder, row["run_id"]),
        }
        for index, row in zip(worst.index, worst.to_dict("records"), strict=True)
    ]


def failure_rows(frame: pd.DataFrame, facts: pd.DataFrame, folder: Path) -> list[dict[str, Any]]:
    """Runs without a valid outcome by cause and group, with one to replay."""
    failed = frame.loc[facts["failed"]]
    return [
        {"cause": keys[0], "group": keys[1], "n": len(part), "command": _replay(folder, part["run_id"].iloc[0])}
        for keys, part in failed.groupby(["failed", "group"], observed=True)
    ]


def _replay(folder: Path, run_id: str) -> str:
    return f"ravenjax trace {shlex.quote(str(folder))} {run_id}"
