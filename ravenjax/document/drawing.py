"""Draws a chart with matplotlib: on given axes, on paper, and as SVG for an HTML page.

In an SVG, colours are custom properties of the style sheet, so charts follow its light and dark
schemes. SVG groups have the names of the data series, so that the page's script can hide a series.
"""

import io
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from ravenjax import resources
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.document.figure_style import INK, PAGE_STYLE, SOFT, STYLE
from ravenjax.document.palette import PALETTE

WIDTHS = {"wide": 520, "narrow": 330}
"""Widths of the two drawings of a chart, px. The style sheet shows the one that fits the page."""
MARGINS = 76
"""Height of titles and ticks, px."""
BAND_OPACITY, FAINT_OPACITY, MANY_BANDS = 0.16, 0.07, 3
"""Opacity of a band, and its opacity in a chart with more than MANY_BANDS bands."""
LETTERS_PER_PX = 0.05
"""Letters of a name beside an axis per px of the width. Longer names are truncated."""
PX_PER_INCH, LETTERS_PER_INCH, LEGEND_ENTRY_INCHES = 100, 14, 2.3
"""In print: px of a chart's height and letters of a title per inch; inches of a legend's name."""
PRINTED = 0.6
"""Size of dots and lines in print, relative to their size on a page."""
_PAPER, _GRID = "#ffffff", STYLE["grid.color"]
_NAMES = {colour.light: name for name, colour in reversed(PALETTE.items())}
_NAMES |= {INK: "ink", SOFT: "soft", _GRID: "line", _PAPER: "paper"}
"""Custom property of each colour."""
_REPLACED = [
    (re.compile(pattern, re.DOTALL), replacement)
    for pattern, replacement in resources.read_tables(__file__, "drawing.toml")["replaced"]
]


def page_drawings(chart: Chart, described_by: str, kinds: Sequence[str]) -> Markup:
    """Return the chart as SVG for each of `kinds`. `described_by`: id of its numbers."""
    with matplotlib.rc_context(PAGE_STYLE):
        drawings = [_page_drawing(chart, kind, described_by) for kind in kinds or WIDTHS]
    return Markup("\n").join(drawings)


def _page_drawing(chart: Chart, kind: str, described_by: str) -> Markup:
    # Returns an SVG whose colours are CSS variables, so that it follows a light or dark page.
    width, height = WIDTHS[kind], chart.height + MARGINS
    # matplotlib writes 72 units of an SVG per inch.
    figure = Figure(figsize=(width / 72, height / 72), layout="constrained", frameon=False)
    axes = figure.subplots()
    draw_chart(chart, axes, page=True, longest=int(LETTERS_PER_PX * width))
    axes.set_xlabel(chart.x.title, loc="right")
    figure.suptitle(chart.y.title, x=0, ha="left", fontsize=12)
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    # Everything after the opening tag <svg ..>, which is replaced below.
    inner = text[text.index(">", text.index("<svg")) + 1 :]
    for pattern, replacement in _REPLACED:
        inner = pattern.sub(replacement, inner)
    for colour, name in _NAMES.items():
        inner = inner.replace(colour, f"var(--{name})")
    inner = with_own_ids(inner, f"{described_by}-{kind}")
    return Markup(
        f'<svg class="{kind}" viewBox="0 0 {width} {height}" role="img"'
        f' aria-label="{escape(chart.words())}" aria-describedby="{escape(described_by)}">{inner}'
    )


def with_own_ids(svg: str, prefix: str) -> str:
    """Return an SVG with a prefix before each id, so that ids are unique on a page."""
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'(xlink:href|href)="#([^"]+)"', rf'\1="#{prefix}-\2"', svg)
    return re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", svg)


def print_figure(
    charts: Sequence[Chart], width: float, columns: int = 1, title: str = ""
) -> Figure:
    """Return charts as panels of a figure for print, with one legend. width: inches."""
    # Height of each row of panels, with 0.9 inches for titles and ticks.
    heights = [
        0.9 + max(chart.height for chart in charts[first : first + columns]) / PX_PER_INCH
        for first in range(0, len(charts), columns)
    ]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, 1.0 + sum(heights)), layout="constrained")
        grid = figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights)
        series = {}
        for chart, axes in zip(charts, grid.flat, strict=False):
            draw_chart(chart, axes)
            axes.set_title(chart.title, fontsize=9, loc="left")
            axes.set(xlabel=chart.x.title, ylabel="" if chart.y.names else chart.y.title)
            for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
                series.setdefault(name, handle)
        for axes in grid.flat[len(charts) :]:
            axes.set_visible(False)
        if title:
            letters = int(LETTERS_PER_INCH * width)
            lines = (textwrap.fill(line, letters) for line in title.splitlines())
            figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=10)
        if series:
            place = "outside lower center"
            entries = int(width / LEGEND_ENTRY_INCHES)
            figure.legend(series.values(), series, loc=place, ncols=entries, fontsize=8)
    return figure


def draw_chart(chart: Chart, axes: Axes, *, page: bool = False, longest: int = 1000) -> None:
    """Draw a chart on empty axes. The caller adds legend and titles.

    `page`: mark curves for a page's script, and draw hidden ones. `longest`: largest number of
    letters of a name beside an axis.
    """
    series = {name: number for number, (name, *_) in enumerate(chart.legend())}
    marks = [mark for mark in chart.marks if page or mark.visible]
    bands = sum(mark.visible and isinstance(mark, Curve) and len(mark.low) > 0 for mark in marks)
    scale = 1.0 if page else PRINTED
    artists = 0
    for mark in marks:
        if isinstance(mark, Curve):
            opacity = FAINT_OPACITY if bands > MANY_BANDS else BAND_OPACITY
            drawn = _draw_curve(mark, axes, opacity, scale)
        else:
            drawn = _draw_dots(mark, axes, scale)
        # `drawn` is a generator, so the loop also draws. In print the elements need no id.
        for artist in drawn:
            if page:
                state = "on" if mark.visible else "off"
                artist.set_gid(f"mark {series.get(mark.name, -1)} {state} {artists}")
                artists += 1
    for name, axis in (("x", chart.x), ("y", chart.y)):
        _format_axis(axes, name, axis, longest)
    # The page's script finds the area of the chart by this id.
    axes.patch.set_gid("hit")


def _format_axis(axes: Axes, name: str, axis: ChartAxis, longest: int):
    # Sets scale, limits and labels of one axis.
    drawn_axis = getattr(axes, f"{name}axis")
    if axis.log:
        getattr(axes, f"set_{name}scale")("log")
    # Names have the positions 0, 1, 2 .. from the top.
    limits = (axis.low, axis.high) if not axis.names else (len(axis.names) - 0.5, -0.5)
    getattr(axes, f"set_{name}lim")(*limits)
    if axis.names:
        names = [word if len(word) <= longest else f"{word[: longest - 1]}…" for word in axis.names]
        drawn_axis.set_ticks(range(len(names)), names)
        drawn_axis.grid(False)
    else:
        drawn_axis.set_minor_locator(NullLocator())
        drawn_axis.set_major_formatter(lambda value, _: axis.label(value))
        if not axis.log:
            drawn_axis.get_major_locator().set_params(nbins=6 if name == "y" else 5)
    if axis.line is not None:
        (axes.axvline if name == "x" else axes.axhline)(axis.line, color=SOFT, lw=1.2, zorder=1)


def _colour(mark: Mark) -> str:
    return PALETTE[mark.colour].light


def _label(mark: Mark) -> str:
    return mark.name if mark.in_legend else "_"


def _draw_curve(mark: Curve, axes: Axes, alpha: float, scale: float) -> Iterator[Any]:
    # Draws a curve and its band with matplotlib; yields the drawn elements.
    colour: Any = {"color": _colour(mark)}
    if len(mark.low):
        step: Any = "post" if mark.step else None
        band = mark.x, mark.low, mark.high
        yield axes.fill_between(*band, alpha=alpha, lw=0, step=step, **colour)
    look: Any = {"lw": 1.5, "ls": (0, (4, 2))} if mark.dashed else {"lw": 2.2, "ls": "-"}
    look["lw"] *= scale
    style = "steps-post" if mark.step else "default"
    yield from axes.plot(mark.x, mark.y, label=_label(mark), drawstyle=style, **colour, **look)


def _draw_dots(mark: Dots, axes: Axes, scale: float) -> Iterator[Any]:
    # Draws dots with intervals and labels with matplotlib; yields the drawn elements.
    look: Any = {"color": _colour(mark), "lw": 1.6 * scale, "alpha": 0.55, "zorder": 2}
    if len(mark.x_low):
        yield axes.hlines(mark.y, mark.x_low, mark.x_high, **look)
    if len(mark.y_low):
        yield axes.vlines(mark.x, mark.y_low, mark.y_high, **look)
    # `scatter` takes squares of the diameters.
    areas = (scale * np.array(mark.size or (8.0,) * len(mark.x))) ** 2
    look = {"marker": "D" if mark.diamond else "o", "edgecolors": _PAPER, "clip_on": False}
    look |= {"linewidths": 1.2 * scale, "zorder": 3, "label": _label(mark)}
    dots = axes.scatter(mark.x, mark.y, areas, _colour(mark), **look)
    dots.set_urls(mark.tips or [None] * len(mark.x))  # pyright: ignore[reportArgumentType]
    yield dots
    # Dots at the same position share one label.
    labels: dict[tuple[float, float], list[str]] = {}
    for x, y, text in zip(mark.x, mark.y, mark.texts, strict=False):
        if text:
            labels.setdefault((float(x), float(y)), []).append(text)
    for position, texts in labels.items():
        yield axes.annotate(", ".join(texts), position, (6, 4), textcoords="offset points")
