"""Colours of the report's figures, safe for colour-blind readers, and what several of them draw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ravenjax.figure_style import faded
from ravenjax.stats.latency import Incidence

CUE, RESPONSE, SAME = "#c2410c", "#0072b2", "#8a8f96"  # vermilion and blue differ in every colour blindness
SERIES = ("#0072b2", "#c2410c", "#009e73", "#8b2a6b", "#56b4e9", "#a67c00", "#cc79a7", "#5b6470")
"""Colours of several curves side by side, after Okabe and Ito."""
MOST_POINTS = 200
"""Points of a drawn curve."""


def round_step(width: float) -> float:
    """The nearest of 1, 2, 2.5, 5 times a power of ten, so that bin edges are round numbers; 1 for 0."""
    if width <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(width))
    return min((m * power for m in (1, 2, 2.5, 5, 10)), key=lambda step: abs(math.log(step / width)))


def thinned(count: int) -> np.ndarray:
    """Which of `count` points of a curve are drawn: all, or MOST_POINTS of them with both ends."""
    if count <= MOST_POINTS:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, MOST_POINTS).round().astype(int))


def stepped(curve: Incidence, end: float, start: float | None = None) -> dict[str, np.ndarray]:
    """x, y, low, high of an incidence, thinned and held until `end`; `start` replaces times below it."""
    kept = thinned(len(curve.time))
    time = np.append(curve.time[kept], max(end, curve.time[-1]))
    if start is not None:
        time = np.maximum(time, start)
    values = {"y": curve.fraction, "low": curve.low, "high": curve.high}
    return {"x": time} | {name: np.append(part[kept], part[-1]).round(6) for name, part in values.items()}


def band(x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, shape: str = "linear") -> dict[str, Any]:
    """The filled band of a curve; points without a value are left out."""
    known = np.isfinite(low) & np.isfinite(high)
    x, low, high = x[known], low[known], high[known]
    return {
        "type": "scatter",
        "x": np.concatenate([x, x[::-1]]).tolist(),
        "y": np.concatenate([high, low[::-1]]).tolist(),
        "fill": "toself",
        "fillcolor": faded(colour),
        "line": {"width": 0, "shape": shape},
        "hoverinfo": "skip",
        "showlegend": False,
    }
