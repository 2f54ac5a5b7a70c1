"""Writes the chain of one run as sentences, tables and a chart."""

import textwrap
from pathlib import Path

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


def chain_title(one: Chain) -> str:
    """Return the title, which names the run."""
    return f"run {one.run_id} · {one.verdict}"


def chain_sentences(one: Chain) -> list[str]:
    """Return the chain as sentences. The last says where a check could detect the fault."""
    return wording.fill_template("chain.txt.j2", chain=one)


def chain_timeline(one: Chain) -> Chart | None:
    """Return a chart with a row for each signal in the robot's order; None if no signal differs.

    Marks show when a signal differs and when it leaves its range. Events of the run are vertical
    lines.
    """
    if not one.links:
        return None
    differs = np.array([link.differs_ms for link in one.links], float)
    leaving = [(place, link) for place, link in enumerate(one.links) if link.leaves_ms >= 0]
    places, leaves, since = (
        np.array([(place, link.leaves_ms, link.differs_ms) for place, link in leaving], float)
        .reshape(-1, 3)
        .T
    )
    moments = [
        ("fault", one.fault_ms, "series3"),
        ("cue", one.cue_ms, CUE),
        ("alarm", one.told_ms, RESPONSE),
        (one.hazard, one.harm_ms, "series6"),
    ]
    moments = [moment for moment in moments if moment[1] >= 0]
    every = np.concatenate([differs, leaves, [ms for _, ms, _ in moments]])
    margin = max(MARGIN_MS, 0.04 * float(every.max() - every.min()))
    low, high = max(0.0, float(every.min()) - margin), float(every.max()) + margin
    upright = np.array([-0.5, len(one.links) - 0.5])
    layers = ["", *(link.layer for link in one.links)]
    names = (
        link.signal if link.layer == layer else f"{link.layer} · {link.signal}"
        for link, layer in zip(one.links, layers, strict=False)
    )
    return Chart(
        chain_title(one),
        ChartAxis("time, ms", low, high, unit="ms"),
        ChartAxis("signals, in the robot's order", 0, len(one.links), names=tuple(names)),
        (
            *(
                Curve(f"{name}, {_ms(ms)}", colour, np.array([ms, ms], float), upright)
                for name, ms, colour in moments
            ),
            Dots(
                "differs in any bit",
                SAME,
                differs,
                np.arange(len(one.links), dtype=float),
                tips=tuple(
                    f"{link.signal}, {link.differs_in} differs at {_ms(link.differs_ms)}"
                    for link in one.links
                ),
            ),
            Dots(
                "leaves its normal range",
                "series2",
                leaves,
                places,
                tips=tuple(
                    f"{link.signal}, {link.leaves_in} out of its range at {_ms(link.leaves_ms)}"
                    for _, link in leaving
                ),
                x_low=since,
                x_high=leaves,
                diamond=True,
            ),
        ),
        height=ROW * len(one.links),
    )


def draw_timeline(one: Chain, path: Path) -> bool:
    """Write the timeline as a file (.svg, .png or .pdf); return False if no signal differs."""
    with matplotlib.rc_context(STYLE):
        drawing = timeline_figure(one)
        if drawing is not None:
            save_figure(drawing, path)
    return drawing is not None


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


def _ms(value: int) -> str:
    return f"{wording.format_count(value)} ms"
