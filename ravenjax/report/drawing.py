"""Writes figures as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.document.chart import Chart
from ravenjax.store.files import write_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DATELESS: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
WIDTH, PX_PER_INCH = 3.6, 100
"""Width of a panel of several, in inches, and scale of a chart's height."""


def save_figure(figure: Figure, path: Path, dpi: int = 160) -> None:
    """Write a figure as its file name says (.svg, .png, .pdf), without a date. `dpi`: of .png."""
    kind = path.suffix.lstrip(".") or "png"
    write_aside(
        path,
        lambda target: figure.savefig(
            target, format=kind, dpi=dpi, metadata=_DATELESS.get(kind, {})
        ),
    )


def save_panels(path: Path, charts: Sequence[Chart], columns: int = 3) -> None:
    """Write charts as panels of one file, with a legend for each series of any of them."""
    import matplotlib
    from matplotlib.figure import Figure

    from ravenjax.document.drawing import draw_chart
    from ravenjax.document.figure_style import STYLE

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
            axes.set(xlabel=chart.x.title, ylabel="" if chart.y.names else chart.y.title)
            for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
                series.setdefault(name, handle)
        for axes in panes[len(charts) :]:
            axes.set_visible(False)
        if series:
            place = "outside lower center"
            figure.legend(series.values(), series, loc=place, ncols=3, fontsize=8)
        save_figure(figure, path)
