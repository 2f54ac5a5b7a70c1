"""How every figure looks, whoever draws it.

Printed ones by matplotlib's settings: text stays text, no file holds a date. Those of the trainer's
pages are plain dicts of plotly's schema, which tests validate: graph objects took most of the time
of a report.
"""

from __future__ import annotations

import json
from typing import Any

INK, SOFT = "#3a424c", "#8a8f96"

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "font.family": "sans-serif",
    "svg.fonttype": "none",
    "svg.hashsalt": "ravenjax",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": SOFT,
    "axes.grid": True,
    "grid.color": "#e8e6e1",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "xtick.color": INK,
    "ytick.color": INK,
}

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
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 1.02,
            "yanchor": "bottom",
            "traceorder": "normal",
        },
        "hoverlabel": {"font": {"family": FONT}},
    }


def json_of(traces: list[dict[str, Any]], layout: dict[str, Any]) -> str:
    """The figure as JSON text; numbers must be finite."""
    return json.dumps({"data": traces, "layout": layout}, allow_nan=False)
