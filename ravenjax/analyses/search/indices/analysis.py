"""Searches of kinds "sobol" and "morris": which inputs decide an outcome, in each case."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import outcome
from ravenjax.analyses.search.file.config import Morris, Sobol
from ravenjax.analyses.search.file.template import Template
from ravenjax.stats.inputs import sensitivity

CONFIDENCE = 0.95
RESAMPLES = 500
"""Bootstrap samples behind an interval."""

Indices = dict[str, dict[str, np.ndarray]]
"""Maps the name of an index to value [inputs], and low and high if there is an interval."""

Analyse = Callable[[np.ndarray], Indices]
"""Maps outcomes of the sample's points [points] to indices."""


def due(template: Template, search: Sobol | Morris) -> int:
    """Return the approximate number of runs."""
    inputs = len(template.inputs)
    points = (
        search.n * (inputs + 2) if isinstance(search, Sobol) else search.trajectories * (inputs + 1)
    )
    return template.cases * points


def find(
    template: Template, search: Sobol | Morris, evaluator: Evaluator, _: Path
) -> dict[str, Any]:
    """Sample the unit cube, run every point in every case, and analyse every outcome."""
    unit, analyse = _design(search, len(template.inputs), template.config.campaign.seed)
    points = len(unit)
    case = np.repeat(np.arange(template.cases), points)
    outcomes = evaluator(case, template.values(case, np.tile(unit, (template.cases, 1))))
    wanted = [outcome.parse_outcome(text) for text in search.outcomes]
    records = []
    for c in range(template.cases):
        for o, one in enumerate(wanted):
            values = outcomes[c * points : (c + 1) * points, o]
            records.append(
                {"case": template.case(c), "outcome": str(one), "unit": one.unit}
                | _of(values, analyse)
            )
    return {
        "method": search.kind,
        "inputs": template.drawn(),
        "points": points,
        "confidence": CONFIDENCE,
        "resamples": RESAMPLES,
        "results": records,
    }


def _of(values: np.ndarray, analyse: Analyse) -> dict[str, Any]:
    """Return the indices of one outcome; None if a run is invalid or all outcomes are equal."""
    invalid = int(np.count_nonzero(~np.isfinite(values)))
    moments: dict[str, Any] = {
        "mean": math.nan,
        "deviation": math.nan,
        "invalid": invalid,
        "indices": None,
    }
    if invalid:
        return moments
    moments |= {"mean": float(values.mean()), "deviation": float(values.std())}
    return moments | ({"indices": analyse(values)} if moments["deviation"] > 0.0 else {})


def _design(search: Sobol | Morris, inputs: int, seed: int) -> tuple[np.ndarray, Analyse]:
    """Return points of the unit cube [points, inputs], and the analysis of their outcomes."""
    if isinstance(search, Sobol):

        def sobol(values: np.ndarray) -> Indices:
            indices = sensitivity.sobol_analyse(
                values, inputs, CONFIDENCE, resamples=RESAMPLES, seed=seed
            )
            return {"S1": _bounded(indices.first), "ST": _bounded(indices.total)}

        return sensitivity.sobol_sample(inputs, search.n, seed), sobol
    unit = sensitivity.morris_sample(inputs, search.trajectories, seed, search.levels)

    def morris(values: np.ndarray) -> Indices:
        effects = sensitivity.morris_analyse(
            unit, values, CONFIDENCE, levels=search.levels, resamples=RESAMPLES, seed=seed
        )
        return {
            "mu_star": _bounded(effects.mu_star),
            "mu": {"value": effects.mu},
            "sigma": {"value": effects.sigma},
        }

    return unit, morris


def _bounded(found: Any) -> dict[str, np.ndarray]:
    return {
        "value": np.asarray(found.value),
        "low": np.asarray(found.low),
        "high": np.asarray(found.high),
    }
