"""Defines matplotlib settings that all printed figures share.

Text stays text, and files hold no date.
"""

from __future__ import annotations

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
