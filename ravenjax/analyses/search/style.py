"""Defines the style of a search's figures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

from ravenjax.document import figure_style
from ravenjax.report.drawing import save_figure

COLOURS = ("#0072b2", "#d9571b", "#8b2a6b", "#009e73", "#7a6a00", "#56b4e9", "#555555")
"""Colours that colour-blind readers can distinguish."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

STYLE: dict[Any, Any] = figure_style.STYLE | {
    "axes.axisbelow": True,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "legend.fontsize": 8,
}


def save_svg(draw: Callable[[dict[str, Any]], Any], numbers: dict[str, Any], path: Path) -> None:
    """Draw the figure of a result and write it as SVG without a date, atomically."""
    with matplotlib.rc_context(STYLE):
        save_figure(draw(numbers), path)
