"""Measures which inputs determine an outcome (searches of kinds "sobol" and "morris").

Each combination of the search file's lists is measured separately. The figure shows Sobol's
indices, or mean and standard deviation of Morris's elementary effects.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import outcome
from ravenjax.analyses.search.file.config import Morris, Sobol
from ravenjax.analyses.search.file.template import Template
from ravenjax.analyses.search.wording import describe_case, short_axis_name
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Dots
from ravenjax.stats import sensitivity

RESAMPLES = 500
"""Number of bootstrap samples for an interval."""
MAX_PANELS = 24

Indices = dict[str, dict[str, np.ndarray]]
"""Maps the name of an index to its value [inputs], and to low and high if it has an interval."""

Analyse = Callable[[np.ndarray], Indices]
"""Function that computes indices from the outcomes [points] of the design's points."""


def expected_runs(template: Template, search: Sobol | Morris) -> int:
    """Return the number of runs, if no point is repeated."""
    inputs = len(template.inputs)
    if isinstance(search, Sobol):
        return template.cases * search.n * (inputs + 2)
    return template.cases * search.trajectories * (inputs + 1)


def find(
    template: Template, search: Sobol | Morris, evaluator: Evaluator, _: Path
) -> dict[str, Any]:
    """Run the design in every case, and return the indices of every outcome for search.json."""
    unit_points, analyse = _design(search, len(template.inputs), template.config.campaign.seed)
    points = len(unit_points)
    case = np.repeat(np.arange(template.cases), points)
    values = evaluator(case, template.values(case, np.tile(unit_points, (template.cases, 1))))
    outcomes = [outcome.parse_outcome(text) for text in search.outcomes]
    records = []
    for number in range(template.cases):
        for wanted, outcome_values in zip(outcomes, values[case == number].T, strict=True):
            record = {
                "case": template.case(number),
                "outcome": str(wanted),
                "unit": wanted.unit,
                **_analyse_outcome(outcome_values, analyse),
            }
            records.append(record)
    return {
        "method": search.kind,
        "inputs": template.describe_inputs(),
        "points": points,
        "confidence": 0.95,
        "resamples": RESAMPLES,
        "results": records,
    }


def _analyse_outcome(values: np.ndarray, analyse: Analyse) -> dict[str, Any]:
    """Return mean, standard deviation, number of invalid runs and indices of one outcome. The
    indices are None if a run is invalid or all values are equal.
    """
    invalid = int(np.count_nonzero(~np.isfinite(values)))
    mean = deviation = math.nan
    if not invalid:
        mean, deviation = float(values.mean()), float(values.std())
    # A comparison with NaN is false.
    indices = analyse(values) if deviation > 0.0 else None
    return {"mean": mean, "deviation": deviation, "invalid": invalid, "indices": indices}


def _design(search: Sobol | Morris, inputs: int, seed: int) -> tuple[np.ndarray, Analyse]:
    # Returns the design's points of the unit cube, and the function that analyses outcomes.
    if isinstance(search, Sobol):

        def analyse_sobol(values: np.ndarray) -> Indices:
            indices = sensitivity.sobol_analyse(values, inputs, resamples=RESAMPLES, seed=seed)
            return {"S1": indices.first._asdict(), "ST": indices.total._asdict()}

        return sensitivity.sobol_sample(inputs, search.n, seed), analyse_sobol
    points = sensitivity.morris_sample(inputs, search.trajectories, seed, search.levels)

    def analyse_morris(values: np.ndarray) -> Indices:
        effects = sensitivity.morris_analyse(
            points, values, levels=search.levels, resamples=RESAMPLES, seed=seed
        )
        return {
            "mu_star": effects.mu_star._asdict(),
            "mu": {"value": effects.mu},
            "sigma": {"value": effects.sigma},
        }

    return points, analyse_morris


def draw(numbers: dict[str, Any]) -> list[Chart]:
    """Return a chart for each case and outcome, from the results of `find`, at most MAX_PANELS."""
    names = tuple(short_axis_name(x["name"]).removeprefix("plant.") for x in numbers["inputs"])
    make_chart = _sobol_chart if numbers["method"] == "sobol" else _morris_chart
    charts = []
    for record in numbers["results"]:
        if record["indices"] is not None:
            # A search file without lists has only one case, whose description is "".
            title = f"{record['outcome']}\n{describe_case(record['case'])}".rstrip("\n")
            charts.append(make_chart(title, names, record["indices"]))
    return charts[:MAX_PANELS]


def _sobol_chart(title: str, names: tuple[str, ...], indices: Indices) -> Chart:
    # Returns a chart of Sobol indices with intervals, one row per input.
    rows = np.arange(len(names), dtype=float)
    series = {"total": indices["ST"], "first order": indices["S1"]}
    dots = tuple(
        Dots(
            label, palette.series_colour(number), index["value"], rows, index["low"], index["high"]
        )
        for number, (label, index) in enumerate(series.items())
    )
    # Estimates may be outside of 0..1.
    low = min(0.0, *(float(np.min(mark.x_low)) for mark in dots))
    high = max(1.0, *(float(np.max(mark.x_high)) for mark in dots))
    across = ChartAxis("share of the variance", low, high, line=0.0)
    up = ChartAxis("", 0.0, len(names), names=names)
    return Chart(title, across, up, dots, height=60 + 30 * len(names))


def _morris_chart(title: str, names: tuple[str, ...], indices: Indices) -> Chart:
    # Returns a chart of Morris effects: mean absolute effect and standard deviation of each input.
    mean, deviation = indices["mu_star"], indices["sigma"]["value"]
    end = 1.08 * float(max(mean["high"].max(), deviation.max()))
    # Each input is a series with one dot, so its arrays have one number.
    dots = tuple(
        Dots(
            name,
            palette.series_colour(i),
            mean["value"][i : i + 1],
            deviation[i : i + 1],
            mean["low"][i : i + 1],
            mean["high"][i : i + 1],
        )
        for i, name in enumerate(names)
    )
    return Chart(
        title,
        ChartAxis("mean |elementary effect|", 0.0, end),
        ChartAxis("standard deviation of the effect", 0.0, end),
        dots,
    )
