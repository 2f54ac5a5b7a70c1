"""Measures which inputs determine an outcome, for each case (searches of kinds "sobol" and
"morris").

The figure shows Sobol's indices, or the mean and the standard deviation of Morris's elementary
effects.
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
from ravenjax.stats.inputs import sensitivity

RESAMPLES = 500
"""Number of bootstrap samples for an interval."""
MOST_PANELS = 24

Indices = dict[str, dict[str, np.ndarray]]
"""Maps the name of an index to its value [inputs], and to low and high if it has an interval."""

Analyse = Callable[[np.ndarray], Indices]
"""Function that computes indices from the outcomes [points] of the design's points."""


def expected_runs(template: Template, search: Sobol | Morris) -> int:
    """Return the approximate number of runs."""
    inputs = len(template.inputs)
    points = (
        search.n * (inputs + 2) if isinstance(search, Sobol) else search.trajectories * (inputs + 1)
    )
    return template.cases * points


def find(
    template: Template, search: Sobol | Morris, evaluator: Evaluator, _: Path
) -> dict[str, Any]:
    """Run the design in every case, and return the indices of every outcome for search.json."""
    unit, analyse = _design(search, len(template.inputs), template.config.campaign.seed)
    points = len(unit)
    case = np.repeat(np.arange(template.cases), points)
    outcomes = evaluator(case, template.values(case, np.tile(unit, (template.cases, 1))))
    wanted = [outcome.parse_outcome(text) for text in search.outcomes]
    records = []
    for c in range(template.cases):
        for one, values in zip(wanted, outcomes[case == c].T, strict=True):
            records.append(
                {"case": template.case(c), "outcome": str(one), "unit": one.unit}
                | _of(values, analyse)
            )
    return {
        "method": search.kind,
        "inputs": template.drawn(),
        "points": points,
        "confidence": 0.95,
        "resamples": RESAMPLES,
        "results": records,
    }


def _of(values: np.ndarray, analyse: Analyse) -> dict[str, Any]:
    """Return mean, deviation and indices of one outcome.

    The indices are None if a run is invalid or all outcomes are equal.
    """
    invalid = int(np.count_nonzero(~np.isfinite(values)))
    mean, deviation = (math.nan,) * 2 if invalid else (float(values.mean()), float(values.std()))
    indices = analyse(values) if deviation > 0.0 else None
    return {"mean": mean, "deviation": deviation, "invalid": invalid, "indices": indices}


def _design(search: Sobol | Morris, inputs: int, seed: int) -> tuple[np.ndarray, Analyse]:
    # Returns the design's points of the unit cube, and the function that analyses their outcomes.
    if isinstance(search, Sobol):

        def sobol(values: np.ndarray) -> Indices:
            indices = sensitivity.sobol_analyse(values, inputs, resamples=RESAMPLES, seed=seed)
            return {"S1": indices.first._asdict(), "ST": indices.total._asdict()}

        return sensitivity.sobol_sample(inputs, search.n, seed), sobol
    unit = sensitivity.morris_sample(inputs, search.trajectories, seed, search.levels)

    def morris(values: np.ndarray) -> Indices:
        # Computes Morris effects from the values of one outcome [runs].
        effects = sensitivity.morris_analyse(
            unit, values, levels=search.levels, resamples=RESAMPLES, seed=seed
        )
        return {
            "mu_star": effects.mu_star._asdict(),
            "mu": {"value": effects.mu},
            "sigma": {"value": effects.sigma},
        }

    return unit, morris


def draw(numbers: dict[str, Any]) -> list[Chart]:
    """Return a chart for each case and outcome, from the results of `find`."""
    names = tuple(short_axis_name(one["name"]).removeprefix("plant.") for one in numbers["inputs"])
    make = _shares if numbers["method"] == "sobol" else _effects
    drawn = [record for record in numbers["results"] if record["indices"] is not None]
    return [
        make(
            "\n".join(filter(None, (record["outcome"], describe_case(record["case"])))),
            names,
            record["indices"],
        )
        for record in drawn[:MOST_PANELS]
    ]


def _shares(title: str, names: tuple[str, ...], indices: Indices) -> Chart:
    # Returns a chart of Sobol indices with intervals, one row per input.
    places = np.arange(len(names), dtype=float)
    dots = tuple(
        Dots(label, palette.series_colour(number), one["value"], places, one["low"], one["high"])
        for number, (label, one) in enumerate(
            (("total", indices["ST"]), ("first order", indices["S1"]))
        )
    )
    low = min(0.0, *(float(np.min(mark.x_low)) for mark in dots))
    high = max(1.0, *(float(np.max(mark.x_high)) for mark in dots))
    across = ChartAxis("share of the variance", low, high, line=0.0)
    up = ChartAxis("", 0.0, len(names), names=names)
    return Chart(title, across, up, dots, height=60 + 30 * len(names))


def _effects(title: str, names: tuple[str, ...], indices: Indices) -> Chart:
    # Returns a chart of Morris effects: mean absolute effect and standard deviation of each input.
    mean, deviation = indices["mu_star"], indices["sigma"]["value"]
    end = 1.08 * float(max(mean["high"].max(), deviation.max()))
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
