"""Look of the report's figures: colours safe for colour-blind readers, the page's font, clear background.

A figure is a plain dict of plotly's schema, which a test validates: graph objects took most of the time of a report.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from ravenjax.stats.latency import Incidence

CUE, RESPONSE, SAME = "#c2410c", "#0072b2", "#8a8f96"  # vermilion and blue differ in every colour blindness
SERIES = ("#0072b2", "#c2410c", "#009e73", "#8b2a6b", "#56b4e9", "#a67c00", "#cc79a7", "#5b6470")
"""Colours of several curves side by side, after Okabe and Ito."""
MOST_POINTS = 200
"""Points of a drawn curve."""
FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
GRID = "rgba(128,128,128,0.2)"


def look(height: int) -> dict[str, Any]:
    """Layout common to all figures; `height` in px."""
    clear = "rgba(0,0,0,0)"
    return {
        "height": height,
        "margin": {"l": 60, "r": 16, "t": 30, "b": 48},
        "paper_bgcolor": clear,
        "plot_bgcolor": clear,
        "font": {"family": FONT, "size": 12},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "traceorder": "normal"},
        "hoverlabel": {"font": {"family": FONT}},
    }


def json_of(traces: list[dict[str, Any]], layout: dict[str, Any]) -> str:
    """The figure as JSON text; numbers must be finite."""
    return json.dumps({"data": traces, "layout": layout}, allow_nan=False)


def faded(colour: str) -> str:
    """#rrggbb as a see-through fill."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.16)"


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
