"""Look of the report's figures: colours safe for colour-blind readers, the page's font, clear background.

A figure is a plain dict of plotly's schema, which a test validates: graph objects took most of the time of a report.
"""

from __future__ import annotations

import json
import math
from typing import Any

CUE, RESPONSE, SAME = "#c2410c", "#0072b2", "#8a8f96"  # vermilion and blue differ in every colour blindness
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
