"""Estimates the probability of a rare event (searches of kind "rare").

The inputs of runs have the distributions of the search file. Each combination of the file's lists
is estimated separately. Subset simulation and plain Monte Carlo sample the same unit cube. If plain
Monte Carlo finds too few events, it gives only a bound. Otherwise both methods must agree.

The figure shows how likely each value of the event's column is, by both methods.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import outcome
from ravenjax.analyses.search.file.config import Rare
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.wording import describe_case
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.stats.rare import LimitState, RareEvent, monte_carlo, subset_simulation

INVALID_DISTANCE = 1e6
"""Distance from the event for a run without a valid outcome, which does not count as an event."""

CURVE_POINTS = 200
"""Number of points of an exceedance curve in search.json."""


def expected_runs(template: Template, search: Rare) -> int:
    """Return the approximate number of runs, for four levels. Rarer events need more levels."""
    return template.cases * (search.check + 4 * search.runs)


def find(template: Template, search: Rare, evaluator: Evaluator, _: Path) -> dict[str, Any]:
    """Estimate the probability in every case, and return the results for search.json."""
    seed, inputs = template.config.campaign.seed, len(template.inputs)
    records = []
    for case in range(template.cases):
        distances = []
        # g appends the distances of its runs from the event to the list.
        g = _limit_state(template, evaluator, case, distances)
        plain = monte_carlo(g, inputs, search.check, seed=seed) if search.check else None
        plain_distances = np.concatenate([np.zeros(0), *distances])
        distances.clear()
        subset = subset_simulation(g, inputs, search.runs, share=1.0 / search.steps, seed=seed + 1)
        all_distances = np.concatenate([plain_distances, *distances])
        # Without a `check`, `plain` and all numbers computed from it are None. The estimates are
        # consistent if their intervals overlap.
        records.append(
            {
                "case": template.case(case),
                "subset": _json_values(subset),
                "monte_carlo": plain and _json_values(plain),
                "consistent": plain and subset.low <= plain.high and plain.low <= subset.high,
                "invalid": int(np.count_nonzero(all_distances >= INVALID_DISTANCE)),
                "exceedance": _exceedance(plain_distances, search),
                "reached": _level_values(subset, search),
            }
        )
    event = outcome.parse_outcome(search.event)
    return {
        "event": search.event,
        "column": event.column,
        "relation": event.relation,
        "bound": event.bound,
        "inputs": template.describe_inputs(),
        "per_level": search.runs,
        "share": 1.0 / search.steps,
        "results": records,
    }


def _limit_state(
    template: Template, evaluator: Evaluator, case: int, distances: list[np.ndarray]
) -> LimitState:
    """Return the function g that maps points [n, inputs] to their distances from the event [n]. The
    event happened if the distance is at most 0. g appends its results to `distances`.
    """

    def g(points: np.ndarray) -> np.ndarray:
        cases = np.full(len(points), case)
        # Margins have the opposite sign: the event happened if the margin is at least 0.
        margins = evaluator(cases, template.values(cases, points))[:, 0]
        distances.append(np.where(np.isfinite(margins), -margins, INVALID_DISTANCE))
        return distances[-1]

    return g


def _json_values(result: RareEvent) -> dict[str, Any]:
    return result._asdict() | {"levels": list(result.levels)}


def _column_value(distance: np.ndarray, search: Rare) -> np.ndarray:
    # Returns the value of the event's column at a distance from the event.
    event = outcome.parse_outcome(search.event)
    return event.bound - distance if event.relation == ">=" else event.bound + distance


def _exceedance(distances: np.ndarray, search: Rare) -> dict[str, list[float]]:
    """Return values of the event's column, and for each value the share of plain Monte Carlo runs
    that were at least as near to the event. distances: of these runs from the event.
    """
    valid = np.sort(distances[distances < INVALID_DISTANCE])
    if not len(valid):
        return {"value": [], "probability": []}
    # The curve has more points near the event, where runs are rare.
    ranks = np.geomspace(1, len(valid), min(CURVE_POINTS, len(valid))).astype(int)
    index = np.unique(ranks) - 1
    return {
        "value": _column_value(valid[index], search).tolist(),
        "probability": ((index + 1) / len(distances)).tolist(),
    }


def _level_values(result: RareEvent, search: Rare) -> list[dict[str, float]]:
    """Return value and probability of each level of the subset simulation, the event last."""
    # The share 1 / steps of the runs of a level reach the next one. The event has the distance 0.
    distances = [level for level in result.levels if level > 0.0]
    probabilities = [search.steps ** -(i + 1.0) for i in range(len(distances))]
    return [
        {"value": float(_column_value(np.array(distance), search)), "probability": probability}
        for distance, probability in zip(
            [*distances, 0.0], [*probabilities, result.probability], strict=True
        )
    ]


def draw(numbers: dict[str, Any]) -> list[Chart]:
    """Return a chart for each case, from the results of `find`."""
    relation = "more" if numbers["relation"] == ">=" else "less"
    charts = []
    for record in numbers["results"]:
        plain, subset = record["exceedance"], record["subset"]
        # A logarithmic axis cannot show a probability of 0.
        levels = [level for level in record["reached"] if level["probability"] > 0.0]
        level_value = np.array([level["value"] for level in levels])
        probability = np.array([level["probability"] for level in levels])
        has_dot = subset["probability"] > 0.0
        event, value, low, high = (
            np.array([number] if has_dot else [])
            for number in (numbers["bound"], subset["probability"], subset["low"], subset["high"])
        )
        name = f"subset simulation, {subset['runs']} runs"
        marks: list[Curve | Dots] = [
            Curve(name, "series1", level_value, probability),
            Dots(name, "series1", event, value, y_low=low, y_high=high),
        ]
        x, y = np.array(plain["value"]), np.array(plain["probability"])
        if len(x):
            name = f"plain Monte Carlo, {record['monte_carlo']['runs']} runs"
            marks.append(Curve(name, "series0", x, y, step=True))
        across = np.concatenate([x, level_value, [numbers["bound"]]])
        least = np.concatenate([y, probability, low[low > 0.0], [1.0]]).min()
        charts.append(
            Chart(
                describe_case(record["case"]),
                ChartAxis(
                    numbers["column"], across.min(), across.max() + 1e-9, line=numbers["bound"]
                ),
                ChartAxis(f"probability of this value or {relation}", least / 2.0, 1.0, log=True),
                tuple(marks),
            )
        )
    return charts
