"""Draws several charts side by side in one SVG file."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from ravenjax.document.chart import Chart
from ravenjax.document.drawing import draw_chart
from ravenjax.document.figure_style import STYLE
from ravenjax.report.drawing import save_figure

WIDTH, PX_PER_INCH = 3.6, 100
"""Width of a panel of several, in inches, and scale of a chart's height."""


def save_panels(path: Path, charts: Sequence[Chart], columns: int = 3) -> None:
    """Write charts as panels of one SVG file, with a legend for each series of any of them."""
    columns = min(columns, len(charts))
    rows = -(-len(charts) // columns)
    height = 1.0 + rows * (0.9 + max(chart.height for chart in charts) / PX_PER_INCH)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(max(7.0, WIDTH * columns), height), layout="constrained")
        panes = figure.subplots(rows, columns, squeeze=False).ravel()
        series = {}
        for chart, axes in zip(charts, panes, strict=False):
            draw_chart(chart, axes)
            axes.set_title(chart.title, fontsize=9, loc="left")
            axes.set(xlabel=chart.x.title, ylabel=chart.y.title)
            for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
                series.setdefault(name, handle)
        for axes in panes[len(charts) :]:
            axes.set_visible(False)
        if series:
            place = "outside lower center"
            figure.legend(series.values(), series, loc=place, ncols=3, fontsize=8)
        save_figure(figure, path)
