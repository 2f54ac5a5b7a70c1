"""Look of a search's figures, that of the report's: `ravenjax.report.trace_plot`, which a search must not import."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ravenjax.store.files import write_aside

COLOURS = ("#0072b2", "#d9571b", "#8b2a6b", "#009e73", "#7a6a00", "#56b4e9", "#555555")
"""Told apart by colour-blind readers."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
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
    "axes.axisbelow": True,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "grid.color": "#e8e6e1",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "xtick.color": INK,
    "ytick.color": INK,
}


def save(figure: Any, path: Path) -> None:
    """As SVG without a date, whole or not at all."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        write_aside(path, lambda target: figure.savefig(target, format="svg", metadata={"Date": None}))
