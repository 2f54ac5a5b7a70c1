"""Estimates the probability of a rare event (searches of kind "rare").

The inputs of runs have the distributions of the search file. Each combination of the file's lists
is estimated separately. Subset simulation and plain Monte Carlo sample the same unit cube. If plain
Monte Carlo finds the event often enough, both methods must agree. Otherwise plain Monte Carlo gives
an upper bound.

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

FAR = 1e6
"""Distance from the event for a run without a valid outcome. Such a run does not count as an event.
"""

CURVE = 200
"""Number of points of an exceedance curve in search.json."""


def expected_runs(template: Template, search: Rare) -> int:
    """Return the approximate number of runs. Rarer events need more levels."""
    return template.cases * (search.check + 4 * search.runs)


def find(template: Template, search: Rare, evaluator: Evaluator, _: Path) -> dict[str, Any]:
    """Estimate the probability in every case, and return the results for search.json."""
    seed, inputs = template.config.campaign.seed, len(template.inputs)
    records = []
    for case in range(template.cases):
        margins: list[np.ndarray] = []
        g = _limit_state(template, evaluator, case, margins)
        plain = monte_carlo(g, inputs, search.check, seed=seed) if search.check else None
        sampled = np.concatenate([np.zeros(0), *margins])
        margins.clear()
        level = subset_simulation(g, inputs, search.runs, share=1.0 / search.steps, seed=seed + 1)
        failed = int(np.count_nonzero(np.concatenate([sampled, *margins]) >= FAR))
        records.append(
            {
                "case": template.case(case),
                "subset": _of(level),
                "monte_carlo": plain and _of(plain),
                "consistent": plain and level.low <= plain.high and plain.low <= level.high,
                "invalid": failed,
                "exceedance": _exceedance(sampled, search),
                "reached": _reached(level, search),
            }
        )
    one = outcome.parse_outcome(search.event)
    return {
        "event": search.event,
        "column": one.column,
        "relation": one.relation,
        "bound": one.bound,
        "inputs": template.drawn(),
        "per_level": search.runs,
        "share": 1.0 / search.steps,
        "results": records,
    }


def _limit_state(
    template: Template, evaluator: Evaluator, case: int, drawn: list[np.ndarray]
) -> LimitState:
    """Return the function g that maps points [n, inputs] to their distances from the event [n].

    The event happened if the distance is at most 0. All distances are appended to `drawn`.
    """

    def g(unit: np.ndarray) -> np.ndarray:
        cases = np.full(len(unit), case)
        beyond = evaluator(cases, template.values(cases, unit))[:, 0]
        drawn.append(np.where(np.isfinite(beyond), -beyond, FAR))
        return drawn[-1]

    return g


def _of(found: RareEvent) -> dict[str, Any]:
    return found._asdict() | {"levels": list(found.levels)}


def _column(distance: np.ndarray, search: Rare) -> np.ndarray:
    one = outcome.parse_outcome(search.event)
    return one.bound - distance if one.relation == ">=" else one.bound + distance


def _exceedance(sampled: np.ndarray, search: Rare) -> dict[str, list[float]]:
    """Return values of the event's column, and the share of plain Monte Carlo runs that were at
    least as near to the event.
    """
    valid = np.sort(sampled[sampled < FAR])
    if not len(valid):
        return {"value": [], "probability": []}
    rank = np.unique(np.geomspace(1, len(valid), min(CURVE, len(valid))).astype(int)) - 1
    return {
        "value": _column(valid[rank], search).tolist(),
        "probability": ((rank + 1) / len(sampled)).tolist(),
    }


def _reached(found: RareEvent, search: Rare) -> list[dict[str, float]]:
    """Return value and probability of each level of the subset simulation, the event last."""
    levels = [level for level in found.levels if level > 0.0]
    likely = [search.steps ** -(i + 1.0) for i in range(len(levels))]
    return [
        {"value": float(_column(np.array(distance), search)), "probability": probability}
        for distance, probability in zip([*levels, 0.0], [*likely, found.probability], strict=True)
    ]


def draw(numbers: dict[str, Any]) -> list[Chart]:
    """Return a chart for each case, from the results of `find`."""
    relation = "more" if numbers["relation"] == ">=" else "less"
    charts = []
    for record in numbers["results"]:
        plain, level = record["exceedance"], record["subset"]
        likely = [one for one in record["reached"] if one["probability"] > 0.0]
        reached, probability = (
            np.array([one[name] for one in likely]) for name in ("value", "probability")
        )
        found = level["probability"] > 0.0
        event, value, low, high = (
            np.array([number])[: int(found)]
            for number in (numbers["bound"], level["probability"], level["low"], level["high"])
        )
        name = f"subset simulation, {level['runs']} runs"
        marks: list[Curve | Dots] = [
            Curve(name, "series1", reached, probability),
            Dots(name, "series1", event, value, y_low=low, y_high=high),
        ]
        x, y = (np.array(plain[name]) for name in ("value", "probability"))
        if len(x):
            name = f"plain Monte Carlo, {record['monte_carlo']['runs']} runs"
            marks.append(Curve(name, "series0", x, y, step=True))
        across = np.concatenate([x, reached, [numbers["bound"]]])
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
