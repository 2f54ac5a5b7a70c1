"""Runs searches of kind "boundary": finds the smallest harmful fault for each sign and each
combination (*cell*) of the group's lists.

The search handles all cells side by side. It scans the range, then bisects every bracket, with one
batch per step. An ordinary campaign runs both ends of every bracket again and must give the same
outcomes.

The scan shows which cells have no single threshold. A cell that is never or always harmful is
censored. If harm begins and ends more than once along the range, the report says so.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import outcome
from ravenjax.analyses.search.file.config import Boundary
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.wording import describe_case, group_series, short_axis_name
from ravenjax.campaign import runner
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots

FOLDER = "verified"
"""Subfolder of the search for the campaign with both sides of every bracket."""


Asked = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Maps (cell [n], number [n]) to [n]: 1 yes, 0 no, NaN no valid answer."""

CROSSING, NEVER, ALWAYS, INVALID = "crossing", "never", "always", "invalid"


@dataclasses.dataclass(frozen=True)
class SearchRange:
    """The range of numbers that is searched."""

    low: float
    high: float
    log: bool  # True if equal ratios, rather than equal differences, are equivalent
    # A bracket is narrow enough at this share of its lower end (log), or of the whole range.
    tolerance: float

    def spread(self, low: np.ndarray, high: np.ndarray, points: int) -> np.ndarray:
        """Return [points, cells] evenly spaced from `low` to `high` [cells], both included."""
        share = np.linspace(0.0, 1.0, points)[:, None]
        if self.log:
            values = np.exp(np.log(low) * (1.0 - share) + np.log(high) * share)
        else:
            values = low * (1.0 - share) + high * share
        values[0], values[-1] = low, high
        return values

    def narrow(self, low: np.ndarray, high: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """Return whether brackets are narrow enough, or contain no further whole number."""
        width = self.tolerance * (low if self.log else self.high - self.low)
        return (high - low <= width) | (whole & (high - low <= 1.0))


@dataclasses.dataclass(frozen=True)
class Brackets:
    """The point at which the answer becomes yes, for each cell."""

    # text [cells]: CROSSING, NEVER, ALWAYS, or INVALID if an answer was not valid.
    state: np.ndarray
    # [cells], largest number below the crossing with a no; NaN without one.
    low: np.ndarray
    high: np.ndarray  # [cells], smallest number with a yes; NaN without one
    # Of each cell, the intervals of the scan in which the answer changes.
    changes: tuple[tuple[tuple[float, float], ...], ...]
    steps: int  # number of steps after the scan

    @property
    def monotone(self) -> np.ndarray:
        """Return whether the answer stays yes after the first yes of the scan; bool [cells]."""
        single = [
            len(changes) <= (state != ALWAYS)
            for state, changes in zip(self.state, self.changes, strict=True)
        ]
        return np.array(single, bool)


def find_brackets(asked: Asked, within: SearchRange, whole: np.ndarray, scan: int) -> Brackets:
    """Return the smallest number for which `asked` returns 1, for every cell.

    `whole`: bool [cells], whether a cell takes only whole numbers. `scan`: count of numbers that
    are tried first, evenly over the range.
    """
    cells = len(whole)
    tried = within.spread(np.full(cells, within.low), np.full(cells, within.high), scan)
    tried = np.where(whole, np.rint(tried), tried)
    answer = asked(np.tile(np.arange(cells), scan), tried.reshape(-1)).reshape(tried.shape)
    state, low, high = _first(answer, tried)
    changes = tuple(_changes(answer[:, cell], tried[:, cell]) for cell in range(cells))
    steps = 0
    while len(active := np.flatnonzero((state == CROSSING) & ~within.narrow(low, high, whole))):
        steps += 1
        tried = within.spread(low[active], high[active], 3)
        # A bracket of whole numbers more than one apart contains another one.
        inner = np.clip(np.rint(tried[1]), low[active] + 1.0, high[active] - 1.0)
        tried[1] = np.where(whole[active], inner, tried[1])
        answer = np.repeat([[0.0], [np.nan], [1.0]], len(active), axis=1)
        answer[1] = asked(active, tried[1])
        state[active], low[active], high[active] = _first(answer, tried)
    return Brackets(state, low, high, changes, steps)


def _first(answer: np.ndarray, tried: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the state, and the first change from no to yes, of each column."""
    yes = answer == 1.0
    first = np.argmax(yes, axis=0)
    cells = np.arange(answer.shape[1])
    state = np.where(~yes.any(axis=0), NEVER, np.where(first == 0, ALWAYS, CROSSING))
    state = np.where(np.isnan(answer).any(axis=0), INVALID, state).astype(object)
    low = np.where(
        state == CROSSING, tried[first - 1, cells], np.where(state == NEVER, tried[-1], np.nan)
    )
    high = np.where(
        state == CROSSING, tried[first, cells], np.where(state == ALWAYS, tried[0], np.nan)
    )
    return state, low, high


def _changes(answer: np.ndarray, tried: np.ndarray) -> tuple[tuple[float, float], ...]:
    # Pairs of neighbouring values between which the answer changes.
    at = np.flatnonzero(answer[1:] != answer[:-1])
    return (
        tuple((float(tried[i]), float(tried[i + 1])) for i in at)
        if not np.isnan(answer).any()
        else ()
    )


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
    steps = math.ceil(math.log2(max(1.0, span / (search.scan - 1))))
    return template.cases * len(search.signs) * (search.scan + steps)


def find(template: Template, search: Boundary, evaluator: Evaluator, out: Path) -> dict[str, Any]:
    """Return the numbers of search.json. Verifies both sides of every boundary in a campaign."""
    axis, grid = template.axis(0), list_cells(template, search)
    low, high = (float(value) for value in axis.values)
    within = SearchRange(low, high, axis.kind == "loguniform", search.tolerance)

    def harm(cell: np.ndarray, size: np.ndarray) -> np.ndarray:
        return evaluator(*grid.points(cell, size))[:, 0]

    whole = template.whole[grid.case, 0]
    bounds = find_brackets(harm, within, whole, search.scan)
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
        "verified": {
            "cells": int(np.count_nonzero(bounds.state == CROSSING)),
            "runs": len(sides),
            "folder": FOLDER,
        },
    }


def _along(told: tuple[dict[str, Any], ...]) -> str | None:
    # The key for the chart's x axis: a duration, or else the number with most values.
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
    if not np.array_equal(outcomes, expected):
        contrary = rows["run_id"][outcomes != expected].tolist()
        raise RuntimeError(
            f"the campaign in {out / FOLDER} contradicts the search that it verifies: runs"
            f" {contrary}"
        )
    index = pd.MultiIndex.from_arrays([np.tile(crossed, 2), expected == 1.0])
    return rows.set_index(index)


def _record(grid: Cells, found: Brackets, sides: pd.DataFrame, cell: int) -> dict[str, Any]:
    # The result of one cell as a record: both ends of the bracket, and their runs.
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


def draw(numbers: dict[str, Any]) -> list[Chart]:
    """Return one chart per value of the first list of the numbers of `find`, with the boundary
    over `along`, and a series for each other case.
    """
    cells, along = numbers["cells"], numbers["along"]
    names = [name for name in cells[0]["cell"] if name != along]
    panel = names[0] if len(names) > 1 else None
    panels: dict[Any, list[dict[str, Any]]] = {}
    for record in cells:
        panels.setdefault(record["cell"].get(panel), []).append(record)
    return [
        _chart("" if panel is None else describe_case({panel: value}), part, numbers)
        for value, part in panels.items()
    ]


def _chart(title: str, cells: list[dict[str, Any]], numbers: dict[str, Any]) -> Chart:
    searched, along = numbers["searched"], numbers["along"]
    ends = {NEVER: searched["high"], ALWAYS: searched["low"]}
    signs = {NEVER: ">", ALWAYS: "<="}
    marks: list[Curve | Dots] = []
    for number, (others, series) in enumerate(group_series(cells, along or "").items()):
        shown = [record for record in series if record["state"] in (CROSSING, *ends)]
        shown.sort(key=lambda record: record["cell"].get(along, 0))
        x = np.array([record["cell"].get(along, 0) for record in shown], float)
        low, high = (
            np.abs([ends.get(record["state"], record[side]) for record in shown])
            for side in ("harmless", "harmful")
        )
        texts = tuple(
            signs.get(record["state"], "") + ("" if record["monotone"] else "†") for record in shown
        )
        name = describe_case(dict(others[1:] if title else others))
        style = name, palette.series_colour(number)
        crossed = np.array([record["state"] == CROSSING for record in shown], bool)
        marks += [
            Curve(*style, x[crossed], high[crossed]),
            Dots(*style, x, high, y_low=low, y_high=high, texts=texts),
        ]
    values = [record["cell"].get(along, 0) for record in cells]
    least, most = min(values), max(values)
    log = least > 0 and most >= 10 * least
    room = 0.5 if least == most else 0.05 * (most - least)
    unit = f", {searched['unit']}" if searched["unit"] else ""
    word = short_axis_name(searched["name"]).partition(",")[0]
    low, high = searched["low"], searched["high"]
    # Room for the marks of cells without a boundary.
    top = high * 1.3 if searched["scale"] == "log" else high + 0.08 * (high - low)
    return Chart(
        title,
        ChartAxis(
            short_axis_name(along or ""),
            least / 1.2 if log else least - room,
            most * 1.2 if log else most + room,
            log=log,
        ),
        ChartAxis(f"smallest harmful {word}{unit}", low, top, log=searched["scale"] == "log"),
        tuple(marks),
    )
