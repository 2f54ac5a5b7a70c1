"""Finds the smallest harmful value of a fault (searches of kind "boundary").

The other keys of the fault may be lists, such as several durations. Each combination of list
entries and a sign (+ or -) is called a *cell*. The search finds the smallest harmful value in each
cell. First it tries a few values over the whole range. It then bisects the interval between the
smallest harmful value and the harmless value below it. A campaign repeats the runs at both ends of
the final interval, to confirm their outcomes.

If all tried values are harmless, or all are harmful, the result of the cell is only a bound. If
some larger value is harmless again, the report states this.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import outcome
from ravenjax.analyses.search.file.config import Boundary
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.wording import describe_case, group_series, short_axis_name
from ravenjax.campaign import runner
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots

FOLDER = "verified"
"""Subfolder for the campaign that repeats the runs at both ends of every bracket."""
SHOWN = ("run", "response", "peak_model_deviation_mm", "peak_golden_deviation_mm")
"""Columns of these runs that the result of a cell contains."""

Evaluate = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function that returns for cells [n] and values [n]: 1 harm, 0 no harm, NaN no valid outcome."""

CROSSING, NEVER, ALWAYS, INVALID = "crossing", "never", "always", "invalid"


@dataclasses.dataclass(frozen=True)
class SearchRange:
    """The range of values in which the smallest harmful value is searched."""

    low: float
    high: float
    log: bool  # True for a logarithmic scale
    tolerance: float  # accepted width of a bracket: share of its lower end (log) or of the range

    def spaced(self, low: np.ndarray, high: np.ndarray, points: int) -> np.ndarray:
        """Return [points, cells] evenly spaced on the scale, from `low` to `high` [cells]."""
        share = np.linspace(0.0, 1.0, points)[:, None]
        if self.log:
            values = np.exp(np.log(low) * (1.0 - share) + np.log(high) * share)
        else:
            values = low * (1.0 - share) + high * share
        # The exact ends, without rounding.
        values[0], values[-1] = low, high
        return values

    def is_narrow(self, low: np.ndarray, high: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """Return whether brackets from `low` to `high` are narrow enough, bool [cells]. A bracket
        of whole numbers is narrow, too, if no whole number lies inside.
        """
        width = self.tolerance * (low if self.log else self.high - self.low)
        return (high - low <= width) | (whole & (high - low <= 1.0))


@dataclasses.dataclass(frozen=True)
class Brackets:
    """The interval in which values become harmful, for each cell."""

    state: np.ndarray  # text [cells]: CROSSING, NEVER or ALWAYS harmful, or INVALID
    low: np.ndarray  # [cells], largest harmless value below the boundary; NaN if there is none
    high: np.ndarray  # [cells], smallest harmful value; NaN if there is none
    # For each cell, the intervals of the scan at whose ends the outcomes differ.
    changes: tuple[tuple[tuple[float, float], ...], ...]
    steps: int  # number of steps of the bisection

    @property
    def monotone(self) -> np.ndarray:
        """Whether all values of the scan after the first harmful one are harmful; bool [cells]."""
        # ALWAYS: the first value is harmful, so no change may follow. Else harm begins at a change.
        monotone = [
            len(changes) <= (0 if state == ALWAYS else 1)
            for state, changes in zip(self.state, self.changes, strict=True)
        ]
        return np.array(monotone, bool)


def find_brackets(
    evaluate: Evaluate, within: SearchRange, whole: np.ndarray, scan: int
) -> Brackets:
    """Find the smallest value for which `evaluate` returns 1, for every cell. `whole`: bool
    [cells], True if only whole numbers are possible. `scan`: number of values that are tried first,
    evenly spaced over the range. A bisection follows.
    """
    cells = len(whole)
    values = within.spaced(np.full(cells, within.low), np.full(cells, within.high), scan)
    values = np.where(whole, np.rint(values), values)
    harm = evaluate(np.tile(np.arange(cells), scan), values.reshape(-1)).reshape(values.shape)
    state, low, high = _bracket_first_harm(harm, values)
    changes = tuple(_list_changes(harm[:, cell], values[:, cell]) for cell in range(cells))
    steps = 0
    while True:
        active = np.flatnonzero((state == CROSSING) & ~within.is_narrow(low, high, whole))
        if not len(active):
            return Brackets(state, low, high, changes, steps)
        steps += 1
        # Only the middle is computed: the lower end is known to be harmless, the upper end harmful.
        values = within.spaced(low[active], high[active], 3)
        # If whole numbers are more than 1 apart, a whole number lies between them.
        whole_middle = np.clip(np.rint(values[1]), low[active] + 1.0, high[active] - 1.0)
        values[1] = np.where(whole[active], whole_middle, values[1])
        harm = np.repeat([[0.0], [np.nan], [1.0]], len(active), axis=1)
        harm[1] = evaluate(active, values[1])
        state[active], low[active], high[active] = _bracket_first_harm(harm, values)


def _bracket_first_harm(
    harm: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `state`, `low` and `high` of `Brackets`. `values`: ascending [values, cells]. `harm`
    of each: 1 harm, 0 no harm, NaN no valid outcome.
    """
    is_harmful = harm == 1.0
    # 0 also in a cell without harm. Only cells in state CROSSING use the value before, first - 1.
    first = np.argmax(is_harmful, axis=0)
    cells = np.arange(harm.shape[1])
    state = np.where(~is_harmful.any(axis=0), NEVER, np.where(first == 0, ALWAYS, CROSSING))
    state = np.where(np.isnan(harm).any(axis=0), INVALID, state).astype(object)
    crossing = state == CROSSING
    low = np.select([crossing, state == NEVER], [values[first - 1, cells], values[-1]], np.nan)
    high = np.select([crossing, state == ALWAYS], [values[first, cells], values[0]], np.nan)
    return state, low, high


def _list_changes(harm: np.ndarray, values: np.ndarray) -> tuple[tuple[float, float], ...]:
    # Returns pairs of neighbouring values with different outcomes; () if an outcome is NaN.
    if np.isnan(harm).any():
        return ()
    last_before = np.flatnonzero(harm[1:] != harm[:-1])
    return tuple((float(values[i]), float(values[i + 1])) for i in last_before)


def expected_runs(template: Template, search: Boundary) -> int:
    """Return the approximate number of runs: of the scan and of the bisection in every cell."""
    # The template has one input, whose distribution is uniform or loguniform.
    low, high = template.axis(0).values
    log = template.axis(0).kind == "loguniform"
    # Each step of the bisection halves an interval of the scan, until it is narrow enough.
    narrow_intervals = (math.log(high / low) if log else 1.0) / search.tolerance
    steps = math.ceil(math.log2(max(1.0, narrow_intervals / (search.scan - 1))))
    return template.cases * len(search.signs) * (search.scan + steps)


def find(template: Template, search: Boundary, evaluator: Evaluator, out: Path) -> dict[str, Any]:
    """Run the search and return its results for search.json. A campaign repeats the runs at both
    ends of every bracket, as a test.
    """
    axis = template.axis(0)
    low, high = map(float, axis.values)
    within = SearchRange(low, high, axis.kind == "loguniform", search.tolerance)
    cells = list(itertools.product(range(template.cases), search.signs))
    case, sign = np.array(cells).T

    def points(cell: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Returns points of cells [n] with fault values of sizes [n]: case [n] and values [n, 1].
        return case[cell], (sign[cell] * size)[:, None]

    def harm(cell: np.ndarray, size: np.ndarray) -> np.ndarray:
        return evaluator(*points(cell, size))[:, 0]

    found = find_brackets(harm, within, template.whole[case, 0], search.scan)
    signed = len(search.signs) > 1
    names = ("state", "harmless", "harmful", "monotone", "changes")
    columns = (found.state, sign * found.low, sign * found.high, found.monotone, found.changes)
    records = [
        {"cell": template.case(number) | ({"sign": "+-"[own < 0]} if signed else {})}
        | dict(zip(names, values, strict=True))
        for (number, own), *values in zip(cells, *columns, strict=True)
    ]
    crossed = np.tile(np.flatnonzero(found.state == CROSSING), 2)
    if len(crossed):
        harmful = np.repeat([False, True], len(crossed) // 2)
        sizes = np.where(harmful, found.high[crossed], found.low[crossed])
        campaign = template.campaign(*points(crossed, sizes))
        rows = runner.run_campaign(campaign, out / FOLDER, evaluator.engine.name).frame()
        again = outcome.parse_outcome(search.harm).values(rows, campaign.rules)
        if (contrary := again != harmful).any():
            raise RuntimeError(
                f"the campaign in {out / FOLDER} repeats runs of the search, but has other outcomes"
                f" in runs {rows['run_id'][contrary].tolist()}. Please report this error"
            )
        rows = rows.rename(columns={"run_id": "run"}).filter(SHOWN)
        for cell, side, row in zip(crossed, harmful, rows.to_dict("records"), strict=True):
            prefix = "harmful" if side else "harmless"
            records[cell] |= {f"{prefix}_{name}": value for name, value in row.items()}
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
        "along": _along([record["cell"] for record in records]),
        "steps": found.steps,
        "scan": search.scan,
        "cells": records,
        "verified": {"cells": len(crossed) // 2, "runs": len(crossed), "folder": FOLDER},
    }


def _along(cells: Sequence[dict[str, Any]]) -> str | None:
    # Returns the key for the chart's x axis: a duration, or else the number with most different
    # values; None if no key has numbers.
    value_counts = {
        name: len({cell[name] for cell in cells})
        for name in cells[0]
        if all(isinstance(cell[name], int | float) for cell in cells)
    }
    durations = [name for name in value_counts if name.endswith("duration_ms")]
    if durations:
        return durations[0]
    return max(value_counts, key=value_counts.__getitem__, default=None)


def draw(numbers: dict[str, Any]) -> list[Chart]:
    """Return charts of the boundary, from the results of `find`. The faults of the search file have
    lists. The list `along` is the horizontal axis. With one more list, each of its values has a
    curve. With further lists, each value of the first one has a chart, and each combination of the
    others has a curve.
    """
    cells, along = numbers["cells"], numbers["along"]
    names = [name for name in cells[0]["cell"] if name != along]
    panel_name = names[0] if len(names) > 1 else None
    records_by_value: dict[Any, list[dict[str, Any]]] = {}
    for record in cells:
        records_by_value.setdefault(record["cell"].get(panel_name), []).append(record)
    return [
        _chart("" if panel_name is None else describe_case({panel_name: value}), records, numbers)
        for value, records in records_by_value.items()
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
    # Leaves room for the marks of cells without a boundary.
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
