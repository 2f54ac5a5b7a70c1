"""Draws a chart on matplotlib's axes, for print: the same points, ticks and colours as on the
page.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.document.chart import MANY, Bars, Chart, Curve, Dots
from ravenjax.document.palette import PALETTE
from ravenjax.document.steps import Steps

TICKS = 6
BAND, FAINT = 0.15, 0.06
"""How much a band covers; the second where many overlap."""


def draw(chart: Chart, axes: Any) -> None:
    """Draw on empty axes what is shown at first; the legend is the caller's."""
    marks = [mark for mark in chart.marks if mark.visible]
    bands = sum(isinstance(mark, Curve) and len(mark.low) > 0 for mark in marks)
    for mark in marks:
        if isinstance(mark, Curve):
            _curve(mark, axes, FAINT if bands > MANY else BAND)
        elif isinstance(mark, Dots):
            _dots(mark, axes)
        else:
            _bars(mark, axes)
    for name, axis in (("x", chart.x), ("y", chart.y)):
        if axis.log:
            getattr(axes, f"set_{name}scale")("log")
        limits = (axis.low, axis.high) if not axis.names else (len(axis.names) - 0.5, -0.5)
        getattr(axes, f"set_{name}lim")(*limits)
        places = axis.ticks(TICKS)
        getattr(axes, f"set_{name}ticks")(places, axis.labels(places))
        getattr(axes, f"set_{name}ticks")([], minor=True)
        getattr(axes, f"set_{name}label")("" if axis.names else axis.title)
        if axis.line is not None:
            (axes.axvline if name == "x" else axes.axhline)(
                axis.line, color=PALETTE["same"].light, lw=0.8
            )


def step_curve(
    axes: Any,
    points: Steps,
    *,
    color: Any,
    scale: float = 1.0,
    alpha: float = 0.15,
    lw: float = 1.4,
    label: str = "",
) -> None:
    """A step curve with its band; values times `scale` (100: percent). color, alpha (of the
    band), lw: matplotlib's.
    """
    low, high, value = (scale * part for part in (points.low, points.high, points.y))
    if (points.low != points.high).any():
        axes.fill_between(points.x, low, high, step="post", color=color, alpha=alpha, lw=0)
    axes.step(points.x, value, where="post", color=color, lw=lw, label=label or None)


def _curve(mark: Curve, axes: Any, alpha: float) -> None:
    colour, label = PALETTE[mark.colour].light, mark.name if mark.in_legend else None
    dashes: Any = (0, (4, 2)) if mark.dashed else "solid"
    if mark.step:
        edges = (mark.low, mark.high) if len(mark.low) else (mark.y, mark.y)
        step_curve(
            axes, Steps(mark.x, mark.y, *edges), color=colour, alpha=alpha, label=label or ""
        )
        axes.lines[-1].set_linestyle(dashes)
        return
    if len(mark.low):
        axes.fill_between(mark.x, mark.low, mark.high, color=colour, alpha=alpha, lw=0)
    axes.plot(mark.x, mark.y, color=colour, lw=1.4, ls=dashes, label=label)


def _dots(mark: Dots, axes: Any) -> None:
    colour = PALETTE[mark.colour].light
    errors = {
        name: [middle - low, high - middle]
        for name, middle, low, high in (
            ("xerr", mark.x, mark.x_low, mark.x_high),
            ("yerr", mark.y, mark.y_low, mark.y_high),
        )
        if len(low)
    }
    style = {
        "fmt": "D" if mark.diamond else "o",
        "ms": 4 if len(mark.x) < 9 else 2.5,
        "color": colour,
        "elinewidth": 0.8,
        "clip_on": False,
    }
    axes.errorbar(mark.x, mark.y, **errors, **style, label=mark.name if mark.in_legend else None)
    for x, y, text in zip(mark.x, mark.y, mark.texts, strict=False):
        if text:
            axes.annotate(text, (x, y), (5, 2), textcoords="offset points", fontsize=7.5)


def _bars(mark: Bars, axes: Any) -> None:
    heights = np.asarray(mark.top) - np.asarray(mark.bottom)
    axes.bar(
        mark.left,
        heights,
        mark.right - mark.left,
        mark.bottom,
        align="edge",
        color=PALETTE[mark.colour].light,
        label=mark.name if mark.in_legend else None,
    )
