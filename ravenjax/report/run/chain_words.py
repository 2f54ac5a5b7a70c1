"""Writes the chain of one run as sentences, tables and a chart."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ravenjax.document import drawing as charts
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.document.figure_style import STYLE
from ravenjax.document.palette import CUE, RESPONSE, SAME
from ravenjax.report import wording
from ravenjax.report.drawing import save_figure
from ravenjax.report.run.chain import Chain

ROW = 15  # px per signal
LETTERS = 92  # characters per line above the drawing
# least margin of the time axis before the first and after the last event
MARGIN_MS = 8
LINKS, CHECKS = (
    ("signal", "layer", "differs from", "out of its range from", "before harm"),
    (
        "check",
        "margin before the first harm",
        "golden run's",
        "least at",
        "trips at",
        "what it does",
    ),
)
"""Columns of the table of links and of the table of checks."""


def chain_title(one: Chain) -> str:
    """Return the title, which names the run."""
    return f"run {one.run_id} · {one.verdict}"


def chain_sentences(one: Chain) -> list[str]:
    """Return the chain as sentences, one per line. The last says where a check could have detected
    the fault.
    """
    return wording.fill_template("chain.txt.j2", chain=one)


def link_rows(one: Chain) -> list[tuple[str, ...]]:
    """Return the chain as a table with columns LINKS. A layer is named only in its first row."""
    rows, layer = [], ""
    for link in one.links:
        left = link.left_ms
        rows.append(
            (
                link.signal,
                link.layer if link.layer != layer else "",
                f"{_ms(link.differs_ms)}, {link.differs_in}",
                f"{_ms(link.leaves_ms)}, {link.leaves_in}" if link.leaves_ms >= 0 else "",
                ("" if left is None else _ms(left) if left > 0 else "after it"),
            )
        )
        layer = link.layer
    return rows


def check_rows(one: Chain) -> list[tuple[str, ...]]:
    """Return the checks as a table with columns CHECKS."""
    return [
        (
            check.check,
            (
                f"{wording.format_number(check.margin)} {check.unit}".strip()
                if np.isfinite(check.margin)
                else wording.DASH
            ),
            wording.format_number(check.golden),
            _ms(check.ms) if check.ms >= 0 else wording.DASH,
            _ms(check.tripped_ms) if check.tripped_ms >= 0 else "never",
            check.does,
        )
        for check in one.checks
    ]


def as_dict(one: Chain) -> dict[str, Any]:
    """Return the chain as plain values for JSON."""
    first = one.first
    return {
        **{name: value for name, value in one._asdict().items() if name not in ("links", "checks")},
        "visible": None if first is None else first._asdict(),
        "links": [link._asdict() for link in one.links],
        "checks": [check._asdict() for check in one.checks],
    }


def chain_timeline(one: Chain) -> Chart | None:
    """Return a chart with a row for each signal in the robot's order; None if no signal differs.

    Marks show when a signal differs and when it leaves its range. Events of the run are vertical
    lines.
    """
    if not one.links:
        return None
    places = np.arange(len(one.links), dtype=float)
    differs = np.array([link.differs_ms for link in one.links], float)
    leaves = np.array([link.leaves_ms for link in one.links], float)
    marks = {
        "fault": one.fault_ms,
        "cue": one.cue_ms,
        "alarm": one.told_ms,
        one.hazard: one.harm_ms,
    }
    marks = {name: ms for name, ms in marks.items() if ms >= 0}
    every = np.concatenate([differs, leaves[leaves >= 0], list(marks.values())])
    margin = max(MARGIN_MS, 0.04 * float(every.max() - every.min()))
    low, high = max(0.0, float(every.min()) - margin), float(every.max()) + margin
    upright = np.array([-0.5, len(one.links) - 0.5])
    colours = {"fault": "series3", "cue": CUE, "alarm": RESPONSE}
    outside = leaves >= 0
    tips = {
        name: tuple(f"{link.signal}, {text(link)}" for link in one.links)
        for name, text in _TIPS.items()
    }
    return Chart(
        chain_title(one),
        ChartAxis("time, ms", low, high, unit="ms"),
        ChartAxis("signals, in the robot's order", 0, len(one.links), names=tuple(_names(one))),
        (
            *(
                Curve(
                    f"{name}, {_ms(ms)}",
                    colours.get(name, "series6"),
                    np.array([ms, ms], float),
                    upright,
                )
                for name, ms in marks.items()
            ),
            Dots("differs in any bit", SAME, differs, places, tips=tips["differs"]),
            Dots(
                "leaves its normal range",
                "series2",
                leaves[outside],
                places[outside],
                tips=tuple(
                    tip for tip, there in zip(tips["leaves"], outside, strict=True) if there
                ),
                x_low=differs[outside],
                x_high=leaves[outside],
                diamond=True,
            ),
        ),
        height=ROW * len(one.links),
    )


def draw_timeline(one: Chain, path: Path) -> Path | None:
    """Write the timeline as a file (.svg, .png or .pdf); return None if no signal differs."""
    with matplotlib.rc_context(STYLE):
        drawing = timeline_figure(one)
        if drawing is None:
            return None
        save_figure(drawing, path)
    return path


def timeline_figure(one: Chain) -> Figure | None:
    """Return the timeline as a figure; None if no signal differs."""
    chart = chain_timeline(one)
    if chart is None:
        return None
    drawing = Figure(figsize=(7.6, 1.6 + 0.17 * len(one.links)), layout="constrained")
    axes = drawing.subplots()
    charts.draw_chart(chart, axes)
    axes.set_xlabel(chart.x.title)
    axes.tick_params("y", labelsize=7.5)
    drawing.suptitle(chart.title, x=0.01, ha="left", fontsize=10, fontweight="bold")
    first, *_, last = chain_sentences(one)
    lines = [textwrap.fill(text, LETTERS) for text in (first, last)]
    axes.set_title("\n".join(lines), loc="left", x=0.0, fontsize=8, color="#3a424c")
    drawing.legend(loc="outside lower left", ncols=3, fontsize=8)
    return drawing


_TIPS = {
    "differs": lambda link: f"{link.differs_in} differs at {_ms(link.differs_ms)}",
    "leaves": lambda link: f"{link.leaves_in} out of its range at {_ms(link.leaves_ms)}",
}


def _names(one: Chain) -> Iterator[str]:
    """Return the row names: signals, with the layer's name on the first signal of each layer."""
    layer = ""
    for link in one.links:
        yield link.signal if link.layer == layer else f"{link.layer} · {link.signal}"
        layer = link.layer


def _ms(value: int) -> str:
    return f"{wording.format_count(value)} ms"
