"""Look of the report's figures: colours safe for colour-blind readers, the page's font, clear background."""

from __future__ import annotations

import math
from typing import Any

import plotly.graph_objects as go

CUE, RESPONSE = "#c2410c", "#0072b2"  # vermilion and blue keep their distance in every colour blindness
RATE_SCALE = [[0.0, "#f7f3ee"], [0.25, "#f6cf9c"], [0.5, "#ec9a4a"], [0.75, "#c9581a"], [1.0, "#7a2a0b"]]
FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
GRID = "rgba(128,128,128,0.2)"


def look(height: int) -> dict[str, Any]:
    """Layout common to all figures; `height` in px."""
    clear = "rgba(0,0,0,0)"
    return {
        "template": "none",
        "height": height,
        "margin": {"l": 60, "r": 16, "t": 30, "b": 48},
        "paper_bgcolor": clear,
        "plot_bgcolor": clear,
        "font": {"family": FONT, "size": 12},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "hoverlabel": {"font": {"family": FONT}},
    }


def json_of(figure: go.Figure) -> str:
    """The figure as JSON text."""
    return str(figure.to_json())


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
