"""What carries the evading faults, and what shows them, as charts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ravenjax.document import axes as printed
from ravenjax.document.chart import EMPTY, Chart, ChartAxis, Curve, Dots
from ravenjax.document.figure_style import STYLE
from ravenjax.document.palette import SAME
from ravenjax.document.ticks import above
from ravenjax.report import wording
from ravenjax.report.sections.chains.carriers import Carrier, Propagation
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.files import write_aside

ROW = 16  # px of a seam
LEAST = 0.1
"""Share of the runs that a passage needs to be drawn."""


def graph(one: Propagation) -> Chart | None:
    """Seams in the robot's order, each at the share of runs that it carries, and at that of runs
    that it shows; lines are the passages from one to the next. None without runs."""
    if not one.carriers:
        return None
    place = {row.seam: number for number, row in enumerate(one.carriers)}
    carries = np.array([row.carries.value for row in one.carriers])
    lines = [
        Curve(
            "next to differ",
            SAME,
            carries[[place[step.before], place[step.after]]],
            np.array([place[step.before], place[step.after]], float),
            in_legend=number == 0,
        )
        for number, step in enumerate(step for step in one.passages if step.rate.value >= LEAST)
    ]
    ranged = [row for row in one.carriers if row.ranged]
    marks = (
        *_dots(
            "differs before harm", "series3", one.carriers, lambda row: row.carries, place, False
        ),
        *_dots(
            "leaves its normal range before harm",
            "series2",
            ranged,
            lambda row: row.shows,
            place,
            True,
        ),
    )
    return Chart(
        "Which signals carry and show the faults that evade",
        ChartAxis("share of evading faults", 0.0, 1.0, share=True),
        _rows(one.carriers),
        (*lines, *marks),
        height=ROW * len(one.carriers),
    )


def leads(one: Propagation) -> Chart | None:
    """The median time from a signal's leaving its range to harm; None where none ever does
    before it.
    """
    rows = [row for row in one.carriers if row.shows.k]
    if not rows:
        return None
    place = {row.seam: number for number, row in enumerate(rows)}
    most = max(max(row.lead_ms.value, float(np.nan_to_num(row.lead_ms.high))) for row in rows)
    return Chart(
        "How long before harm a signal leaves its range",
        ChartAxis("median, ms before harm", 0.0, above(1.02 * most), unit="ms"),
        _rows(rows),
        (
            *_dots(
                "of the faults that it shows", "series2", rows, lambda row: row.lead_ms, place, True
            ),
        ),
        height=ROW * len(rows),
    )


def draw(one: Propagation, path: Path) -> Path | None:
    """Both charts beside each other as a file (.svg, .png or .pdf); None without runs."""
    charts = [chart for chart in (graph(one), leads(one)) if chart is not None]
    if not charts:
        return None
    with matplotlib.rc_context(STYLE):
        figure = Figure(
            figsize=(5.4 * len(charts), 1.5 + 0.2 * len(one.carriers)), layout="constrained"
        )
        for axes, chart in zip(
            figure.subplots(1, len(charts), squeeze=False)[0], charts, strict=True
        ):
            printed.draw(chart, axes)
            axes.set_xlabel(chart.x.title)
            axes.tick_params("y", labelsize=8)
            axes.set_title(chart.title, loc="left", fontsize=9.5, fontweight="bold")
            axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), fontsize=8)
        metadata: Any = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(
            path.suffix.lstrip("."), {}
        )
        kind = path.suffix.lstrip(".") or "svg"
        write_aside(
            path, lambda target: figure.savefig(target, format=kind, dpi=160, metadata=metadata)
        )
    return path


def _rows(carriers: Sequence[Carrier]) -> ChartAxis:
    return ChartAxis(
        "signals, in the robot's order", 0, len(carriers), names=tuple(row.seam for row in carriers)
    )


def _dots(
    name: str,
    colour: str,
    rows: Sequence[Carrier],
    number: Callable[[Carrier], Rate | Estimate],
    place: Any,
    diamond: bool,
) -> list[Dots]:
    """One mark a row: those with an interval, and those without, of one name."""
    values = [number(row) for row in rows]
    bounded = np.array(
        [math.isfinite(value.low) and math.isfinite(value.high) for value in values], bool
    )
    out = []
    for some in (bounded, ~bounded):
        mine = [(row, value) for row, value, there in zip(rows, values, some, strict=True) if there]
        edges = [
            np.array([getattr(value, end) for _, value in mine], float) for end in ("low", "high")
        ]
        low, high = edges if some is bounded else (EMPTY, EMPTY)
        if mine:
            out.append(
                Dots(
                    name,
                    colour,
                    np.array([value.value for _, value in mine], float),
                    np.array([place[row.seam] for row, _ in mine], float),
                    x_low=low,
                    x_high=high,
                    tips=tuple(
                        f"{row.seam}: {_words(value)}, {row.meaning}" for row, value in mine
                    ),
                    diamond=diamond,
                    in_legend=not out,
                )
            )
    return out


def _words(value: Rate | Estimate) -> str:
    if isinstance(value, Rate):
        return (
            f"{wording.percent(value.value)} ({wording.count(value.k)} of {wording.count(value.n)})"
        )
    return wording.estimate(value, "ms")
