"""Searches of kind "boundary": the smallest fault that does harm, for each combination of the
group's lists and each sign.

All cells are searched side by side: first a scan of the range, then bisection of every bracket,
with one batch per step. Both ends of every bracket are run again as an ordinary campaign, which
must give the same outcomes.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.analyses.search.boundary import brackets
from ravenjax.analyses.search.boundary.brackets import CROSSING, Brackets, SearchRange
from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import outcome
from ravenjax.analyses.search.file.config import Boundary
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.wording import group_series
from ravenjax.campaign import runner

FOLDER = "verified"
"""Subfolder of the search for the campaign with both sides of every bracket."""


@dataclasses.dataclass(frozen=True)
class Cells:
    """The cells of a boundary: every case with every sign."""

    case: np.ndarray  # int [cells]
    sign: np.ndarray  # float [cells]
    labels: tuple[dict[str, Any], ...]  # what distinguishes each cell from the others

    def points(self, cell: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cells and sizes as case [n] and values [n, 1]."""
        return self.case[cell], (self.sign[cell] * size)[:, None]


def list_cells(template: Template, search: Boundary) -> Cells:
    """Return every cell, with signs varying fastest."""
    pairs = list(itertools.product(range(template.cases), search.signs))
    signed = len(search.signs) > 1
    names = tuple(
        template.case(case) | ({"sign": "+-"[sign < 0]} if signed else {}) for case, sign in pairs
    )
    return Cells(np.array([c for c, _ in pairs]), np.array([s for _, s in pairs], float), names)


def due(template: Template, search: Boundary) -> int:
    """Return the approximate number of runs."""
    low, high = template.axis(0).values
    log = template.axis(0).kind == "loguniform"
    span = math.log(high / low) / search.tolerance if log else 1.0 / search.tolerance
    steps = math.log(max(1.0, span / (search.scan - 1)), search.sections)
    return (
        template.cases
        * len(search.signs)
        * (search.scan + math.ceil(steps) * (search.sections - 1))
    )


def find(template: Template, search: Boundary, evaluator: Evaluator, out: Path) -> dict[str, Any]:
    """Return the numbers of search.json. Verifies both sides of every boundary in a campaign."""
    axis, grid = template.axis(0), list_cells(template, search)
    low, high = (float(value) for value in axis.values)
    within = SearchRange(low, high, axis.kind == "loguniform", search.tolerance)

    def harm(cell: np.ndarray, size: np.ndarray) -> np.ndarray:
        return evaluator(*grid.points(cell, size))[:, 0]

    whole = template.whole(grid.case)[:, 0]
    bounds = brackets.find_brackets(harm, within, whole, search.scan, search.sections)
    sides = _verified(template, search, evaluator, grid, bounds, out)
    records = [_record(grid, bounds, sides, cell) for cell in range(len(grid.case))]
    return {
        "harm": search.harm,
        "searched": {
            "name": template.labels[0],
            "unit": template.unit(0),
            "low": low,
            "high": high,
            "scale": "log" if within.log else "linear",
            "tolerance": search.tolerance,
        },
        "along": _along(grid.labels),
        "steps": bounds.steps,
        "scan": search.scan,
        "cells": records,
        "exponents": _exponents(records, _along(grid.labels)),
        "verified": {
            "cells": int(np.count_nonzero(bounds.state == CROSSING)),
            "runs": len(sides),
            "folder": FOLDER,
        },
    }


def _along(told: tuple[dict[str, Any], ...]) -> str | None:
    """Return the list of numbers along which to tabulate: durations, else the longest list."""
    numeric = {
        name: len({cell[name] for cell in told})
        for name in told[0]
        if all(isinstance(cell[name], int | float) for cell in told)
    }
    durations = [name for name in numeric if name.endswith("duration_ms")]
    return durations[0] if durations else max(numeric, key=numeric.__getitem__, default=None)


def _verified(
    template: Template,
    search: Boundary,
    evaluator: Evaluator,
    grid: Cells,
    found: Brackets,
    out: Path,
) -> pd.DataFrame:
    """Return rows of a campaign of both sides of every bracket, by cell and harm (bool).

    Raises RuntimeError if that campaign contradicts the search.
    """
    crossed = np.flatnonzero(found.state == CROSSING)
    if not len(crossed):
        return pd.DataFrame()
    case, values = grid.points(
        np.tile(crossed, 2), np.concatenate([found.low[crossed], found.high[crossed]])
    )
    campaign = template.campaign(case, values)
    rows = runner.run_campaign(campaign, out / FOLDER, evaluator.engine.name).frame()
    expected = np.repeat([0.0, 1.0], len(crossed))
    outcomes = outcome.parse_outcome(search.harm).values(rows, campaign.rules)
    if not np.array_equal(outcomes, expected) or rows["run_id"].tolist() != evaluator.ids(
        case, values
    ):
        contrary = rows["run_id"][outcomes != expected].tolist()
        raise RuntimeError(
            f"the campaign in {out / FOLDER} contradicts the search that it verifies: runs"
            f" {contrary}"
        )
    index = pd.MultiIndex.from_arrays([np.tile(crossed, 2), expected == 1.0])
    return rows.set_index(index)


def _record(grid: Cells, found: Brackets, sides: pd.DataFrame, cell: int) -> dict[str, Any]:
    record: dict[str, Any] = {
        "cell": grid.labels[cell],
        "state": str(found.state[cell]),
        "harmless": grid.sign[cell] * found.low[cell],
        "harmful": grid.sign[cell] * found.high[cell],
        "monotone": bool(found.monotone[cell]),
        "changes": found.changes[cell],
    }
    if found.state[cell] == CROSSING:
        for name, harmful in (("harmless", False), ("harmful", True)):
            row = sides.loc[(cell, harmful)]
            record[f"{name}_run"] = row["run_id"]
            record[f"{name}_response"] = row["response"]
            for column in ("peak_model_deviation_mm", "peak_golden_deviation_mm"):
                record[f"{name}_{column}"] = float(row[column])
    return record


def _exponents(records: list[dict[str, Any]], along: str | None) -> list[dict[str, Any]]:
    """Return d log(boundary) / d log(duration) between durations; -1: only the impulse counts."""
    if along is None or not along.endswith("duration_ms"):
        return []
    exponents = []
    for others, line in group_series(records, along).items():
        crossed = sorted(
            (r["cell"][along], abs(r["harmful"]))
            for r in line
            if r["state"] == CROSSING and r["monotone"]
        )
        for (x0, y0), (x1, y1) in itertools.pairwise(crossed):
            slope = (
                math.log(y1 / y0) / math.log(x1 / x0) if min(y0, y1) > 0 and x1 > x0 else math.nan
            )
            exponents.append({"cell": dict(others), "from_ms": x0, "to_ms": x1, "exponent": slope})
    return exponents
