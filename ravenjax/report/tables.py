"""The report's numbers: every rate with its n and Wilson interval, failed runs counted and never dropped."""

from __future__ import annotations

import functools
import itertools
import math
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.report import wording
from ravenjax.report.counted import Delays, median
from ravenjax.report.facts import FACTS, OUTCOMES
from ravenjax.report.runs import Runs
from ravenjax.stats.intervals import Rate, wilson
from ravenjax.store import schema
from ravenjax.store.manifest import Manifest
from ravenjax.store.query import RESULTS, text

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


def headline(runs: Runs) -> dict[str, Any]:
    """Counts of distinct faults: a fault that was run several times counts once, and as evading if it ever did.

    Where some operators react to the cue, all is of the runs in which nobody does.
    """
    (ever,) = runs.ever("plain AND faulty")
    both = "NOT failed AND cue_ms >= 0 AND response_ms >= 0"
    total, late, activated, came, first, same, *outcomes = runs.counts(
        [
            "true",
            "haptic AND response = 'stopped' AND cue_ms > response_ms",
            "activated",
            both,
            f"{both} AND cue_ms < response_ms",
            f"{both} AND cue_ms = response_ms",
            *(f"outcome = {text(name)}" for name in OUTCOMES),
        ],
        where="plain AND faulty",
    )
    free, felt, told = runs.counts(
        ["true", "haptic", "response <> 'silent'"], where="plain AND NOT faulty AND NOT failed"
    )
    leads = runs.table.frame(
        f"SELECT response_ms - cue_ms AS ms, count(*) AS n FROM {FACTS} WHERE plain AND faulty AND {both} GROUP BY ms"
    )
    counted = dict(zip(OUTCOMES, outcomes, strict=True))
    return {
        "evaded": rate_of(ever.evaded, ever.faults),
        "felt": counted["felt"],
        "phantom": counted["phantom"],
        "late": late,
        "unseen": counted["unseen"],
        "runs": total,
        "repeated": total > ever.faults,
        "failed": counted["failed"],
        "activated": rate_of(activated, total),
        "outcomes": {name: rate_of(k, total) for name, k in counted.items()},
        "cue_first": rate_of(first, came),
        "same_ms": same,
        "lead_ms": median(leads["ms"].to_numpy(), leads["n"].to_numpy()),
        "false_cue": rate_of(felt, free),
        "false_response": rate_of(told, free),
    }


def verdict_matrix(runs: Runs) -> list[dict[str, Any]]:
    """Rows stopped, flagged, silent; cells by haptic and jump, each a rate of all runs with a fault."""
    cube = runs.cube()
    return _matrix(cube.loc[cube["faulty"]])


def _matrix(counted: pd.DataFrame) -> list[dict[str, Any]]:
    total = int(counted["runs"].to_numpy().sum())
    found = _by(counted, ["response", "haptic", "jump"])
    rows = []
    for response in schema.RESPONSES:
        of_cells = {key: found.get((response, *key), 0) for key in itertools.product((True, False), repeat=2)}
        cells = [
            {
                "rate": rate_of(k, total),
                "evades": response == "silent" and haptic,
                "unseen": response == "silent" and jump and not haptic,
            }
            for (haptic, jump), k in of_cells.items()
        ]
        rows.append({"name": response, "cells": cells, "total": rate_of(sum(of_cells.values()), total)})
    return rows


def _by(counted: pd.DataFrame, names: list[str]) -> dict[tuple[Any, ...], int]:
    """Runs by what these columns hold."""
    found: dict[tuple[Any, ...], int] = {}
    for *key, runs in zip(*(counted[name].tolist() for name in (*names, "runs")), strict=True):
        found[tuple(key)] = found.get(tuple(key), 0) + runs
    return found


def matrix_cells(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A verdict matrix cell by cell."""
    names = [(cue, jump) for cue in ("haptic", "no haptic") for jump in ("jump", "no jump")]
    return [
        {"response": row["name"], "cue": cue, "jump": jump, "share": cell["rate"]}
        for row in rows
        for (cue, jump), cell in zip(names, row["cells"], strict=True)
    ]


def group_rows(runs: Runs, plain: bool = False) -> list[dict[str, Any]]:
    """One row per group: its outcomes as rates and its own verdict matrix; plain: of runs that are."""
    cube = runs.cube()
    faults = {one.name: one.faults for one in runs.ever("plain" if plain else "true", "group")}
    rows = []
    for name, part in (cube.loc[cube["plain"]] if plain else cube).groupby("group"):
        n = int(part["runs"].to_numpy().sum())
        counted = _by(part, ["outcome"])
        rows.append(
            {
                "name": name,
                "n": n,
                "faulty": bool(part["faulty"].any()),
                "distinct": faults[str(name)],
                "outcomes": {key: rate_of(counted.get((key,), 0), n) for key in OUTCOMES},
                "evaded": rate_of(_by(part, ["evaded"]).get((True,), 0), n),
                "matrix": _matrix(part),
                "failed": _by(part, ["failed"]).get((True,), 0),
            }
        )
    return sorted(rows, key=lambda row: (not row["faulty"], -row["evaded"].value))


def delays(runs: Runs, event: str, end_ms: int, where: str = "true") -> tuple[Delays, int]:
    """Delay (ms) of an event, a column of facts, after the fault's first effect, for activated valid runs; to the end
    of observation where it never came: a stop or the end of the run.

    And how many runs are left out because the event came before the fault did anything.
    """
    chosen = f"({where}) AND activated AND NOT failed AND faulty"
    early = f"{event} >= 0 AND {event} < active_ms"
    end = f"greatest(CASE WHEN response = 'stopped' THEN response_ms ELSE {end_ms} END, active_ms)"
    found = runs.delays(event, "active_ms", end, f"{chosen} AND NOT ({early})")
    return found[""], runs.count(f"{chosen} AND {early}")


def check_rows(runs: Runs, manifest: Manifest) -> list[dict[str, Any]]:
    """One row per built-in check: how often it tripped and how close it came in silent runs."""
    checks = manifest.shape.checks
    asked = ["count(*)"]
    for check in checks:
        margin = f"check_{check}_margin"
        asked.append(f"count(*) FILTER (check_{check}_first_ms >= 0)")
        asked.append(f"min({margin}) FILTER (starts_with(verdict, 'silent/') AND NOT isnan({margin}::DOUBLE))")
    total, *found = runs.table.row(f"SELECT {', '.join(asked)} FROM {RESULTS} WHERE {runs.faulty_and_valid}")
    rows = []
    for check, tripped, margin in zip(checks, found[::2], found[1::2], strict=True):
        unit, what = schema.CHECKS.get(check, ("1", ""))
        rows.append(
            {
                "name": check,
                "what": what,
                "tripped": rate_of(tripped, total),
                "closest": math.nan if margin is None else float(margin),
                "unit": "" if unit == "1" else unit,
            }
        )
    return sorted(rows, key=lambda row: -row["tripped"].k)


def cause_rows(runs: Runs) -> list[dict[str, Any]]:
    """What the first response of the flagged and stopped runs was, the most frequent first."""
    found = runs.table.rows(
        "SELECT response_cause::VARCHAR AS cause, count(*) FILTER (starts_with(verdict, 'stopped/')) AS stopped, "
        f"count(*) FILTER (starts_with(verdict, 'flagged/')) AS flagged FROM {RESULTS} WHERE {runs.faulty_and_valid} "
        "GROUP BY cause HAVING stopped + flagged > 0 ORDER BY stopped + flagged DESC, cause"
    )
    return [
        {"cause": cause or "not recorded", "stopped": stopped, "flagged": flagged} for cause, stopped, flagged in found
    ]


def worst_rows(runs: Runs, folder: Path) -> list[dict[str, Any]]:
    """The silent faulty runs that moved the instrument farthest from the model, and the command that replays each."""
    far = "peak_model_deviation_mm"
    worst = runs.table.rows(
        f"SELECT row FROM {RESULTS} WHERE {runs.faulty_and_valid} AND starts_with(verdict, 'silent/') "
        f"ORDER BY isnan({far}::DOUBLE), {far} DESC, row LIMIT {WORST}"
    )
    rows = runs.numbered([row for (row,) in worst])
    return [
        {
            "run_id": row["run_id"],
            "group": row["group"],
            "fault": wording.fault(row),
            "deviation_mm": row[far],
            "step_mm": row["largest_step_mm"],
            "depth_mm": row["tissue_depth_mm"],
            "cue_ms": row["cue_ms"] - row["first_active_ms"] if row["cue_ms"] >= 0 else None,
            "verdict": row["verdict"],
            "command": _replay(folder, row["run_id"]),
        }
        for row in rows
    ]


def failure_rows(runs: Runs, folder: Path) -> list[dict[str, Any]]:
    """Runs without a valid outcome by cause and group, with one to replay."""
    found = runs.table.rows(
        f'SELECT failed::VARCHAR AS cause, "group"::VARCHAR AS name, count(*), arg_min(run_id, row) FROM {RESULTS} '
        "WHERE failed <> '' GROUP BY cause, name ORDER BY cause, name"
    )
    return [
        {"cause": cause, "group": group, "n": n, "command": _replay(folder, run_id)}
        for cause, group, n, run_id in found
    ]


def _replay(folder: Path, run_id: str) -> str:
    return f"ravenjax trace {shlex.quote(str(folder))} {run_id}"
