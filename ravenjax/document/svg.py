"""Draws a chart as SVG for a page: once for wide places and once for narrow ones, of which the
style sheet shows one.

Colours and fonts are the style sheet's (classes and custom properties), so that the page's scheme
holds for charts too.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from ravenjax.document.chart import MANY, Bars, Chart, Curve, Dots, Mark
from ravenjax.document.steps import corners

WIDTHS = {"wide": 520, "narrow": 330}
"""Of the drawing, px; text is 12 px high at that width."""
TOP, BOTTOM, RIGHT = 26, 42, 14  # px about the drawn area
LETTER = 6.4  # px, mean width of a letter
LINE = 13  # px, least distance of two texts
TICK = 54  # px, least distance of ticks along
MOST_UP = 6  # ticks upwards
SIZE = 8.0  # px, of a mark
LONGEST = 0.38
"""Of the width that names of places may take; longer ones are cut, the table of numbers has them
whole.
"""


def drawings(chart: Chart, described_by: str) -> Markup:
    """Both drawings; described_by: id of the element that holds the chart's numbers."""
    return Markup("\n").join(
        _drawing(chart, kind, width, described_by) for kind, width in WIDTHS.items()
    )


def values(chart: Chart) -> str:
    """What the page's reader of values needs, as JSON: axes, and each curve point by point."""
    content: dict[str, Any] = {
        name: {
            "low": axis.low,
            "high": axis.high,
            "log": axis.log,
            "share": axis.share,
            "unit": axis.unit,
        }
        | {"title": axis.title}
        for name, axis in (("x", chart.x), ("y", chart.y))
    }
    content["curves"] = [
        {"name": one.name, "step": one.step, "x": _rounding(one.x), "y": _rounding(one.y)}
        for one in chart.marks
        if isinstance(one, Curve) and one.in_legend
    ]
    return json.dumps(content, allow_nan=False, separators=(",", ":"))


def _rounding(numbers: np.ndarray) -> list[float]:
    return [float(f"{value:.5g}") for value in numbers]


class _Area:
    """Where a chart draws: pixels of values."""

    def __init__(self, chart: Chart, width: int) -> None:
        self.chart, self.width = chart, width
        self.up = chart.y.ticks(MOST_UP)
        self.up_labels = (
            _cut(chart.y.labels(self.up), width) if chart.y.names else chart.y.labels(self.up)
        )
        self.left = 12 + LETTER * max(map(len, self.up_labels), default=0)
        self.wide, self.high = width - self.left - RIGHT, chart.height
        self.along = chart.x.ticks(max(2, int(self.wide / TICK)))

    def x(self, values: Any) -> np.ndarray:
        """Pixels from the left of the drawn area."""
        return self.wide * self.chart.x.place(np.asarray(values, float))

    def y(self, values: Any) -> np.ndarray:
        """Pixels from its top."""
        return self.high * (1.0 - self.chart.y.place(np.asarray(values, float)))


def _drawing(chart: Chart, kind: str, width: int, described_by: str) -> Markup:
    area = _Area(chart, width)
    bands = sum(
        mark.visible and isinstance(mark, Curve) and len(mark.low) > 0 for mark in chart.marks
    )
    faint = " faint" if bands > MANY else ""
    series = {name: number for number, (name, *_) in enumerate(chart.legend())}
    inner = "".join(
        _group(mark, area, series) for mark in chart.marks if not isinstance(mark, Dots)
    )
    outer = "".join(_group(mark, area, series) for mark in chart.marks if isinstance(mark, Dots))
    return Markup(
        f'<svg class="{kind}{faint}" viewBox="0 0 {width} {TOP + area.high + BOTTOM}" role="img"'
        f' aria-label="{escape(chart.words())}"'
        f' aria-describedby="{escape(described_by)}">{_frame(area)}<svg class="area"'
        f' x="{area.left:.1f}" y="{TOP}" width="{area.wide:.1f}" height="{area.high}"><rect'
        f' class="hit" width="100%" height="100%"/>{inner}</svg><g'
        f' transform="translate({area.left:.1f},{TOP})">{outer}</g></svg>'
    )


def _frame(area: _Area) -> str:
    """Grid, ticks and titles."""
    chart, bottom = area.chart, TOP + area.high
    out = [f'<text class="axis" x="0" y="12">{escape(chart.y.title)}</text>']
    for value, label in zip(area.up, area.up_labels, strict=True):
        y = TOP + float(area.y(value))
        if not chart.y.names:
            out.append(_segment("grid", area.left, y, area.left + area.wide, y))
        out.append(
            f'<text class="tick" x="{area.left - 7:.1f}" y="{y + 4:.1f}"'
            f' text-anchor="end">{escape(label)}</text>'
        )
    for value, label in zip(area.along, chart.x.labels(area.along), strict=True):
        x = area.left + float(area.x(value))
        out.append(_segment("grid", x, TOP, x, bottom))
        half = LETTER * len(label) / 2
        x = min(x, area.width - half)  # the last label stays inside
        out.append(
            f'<text class="tick" x="{x:.1f}" y="{bottom + 16}"'
            f' text-anchor="middle">{escape(label)}</text>'
        )
    for axis, horizontal in ((chart.x, False), (chart.y, True)):
        if axis.line is not None and axis.low <= axis.line <= axis.high:
            at = float(area.y(axis.line) + TOP if horizontal else area.x(axis.line) + area.left)
            ends = (
                (area.left, at, area.left + area.wide, at) if horizontal else (at, TOP, at, bottom)
            )
            out.append(_segment("zero", *ends))
    title = escape(chart.x.title)
    out.append(
        f'<text class="axis" x="{area.left + area.wide:.1f}" y="{bottom + 35}"'
        f' text-anchor="end">{title}</text>'
    )
    return "".join(out)


def _segment(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _group(mark: Mark, area: _Area, series: dict[str, int]) -> str:
    draw = {Curve: _curve, Bars: _bars, Dots: _dots}[type(mark)]
    number = series.get(mark.name, -1)
    state = "" if mark.visible else " off"
    return (
        f'<g class="mark{state}" data-series="{number}" style="--c:var(--{mark.colour})">'
        f"{''.join(draw(mark, area))}</g>"  # pyright: ignore[reportArgumentType]
    )


def _curve(mark: Curve, area: _Area) -> Iterator[str]:
    if len(mark.low):
        finite = np.isfinite(mark.low) & np.isfinite(mark.high)
        x, low, high = mark.x[finite], mark.low[finite], mark.high[finite]
        edges = [corners(x, edge) if mark.step else (x, edge) for edge in (high, low)]
        (ahead, above), (back, below) = edges
        outline = np.concatenate([ahead, back[::-1]]), np.concatenate([above, below[::-1]])
        yield f'<path class="band" d="{_path(area, *outline)}Z"/>'
    finite = np.isfinite(mark.y)
    line = (
        corners(mark.x[finite], mark.y[finite]) if mark.step else (mark.x[finite], mark.y[finite])
    )
    yield f'<path class="line{" dashed" if mark.dashed else ""}" d="{_path(area, *line)}"/>'


def _path(area: _Area, x: np.ndarray, y: np.ndarray) -> str:
    """Through these points: tenths of pixels, relative to the point before."""
    across, up = np.round(10 * area.x(x)).astype(int), np.round(10 * area.y(y)).astype(int)
    if not len(across):
        return "M0,0"
    out = [f"M{_tenth(across[0])},{_tenth(up[0])}"]
    for dx, dy in zip(np.diff(across), np.diff(up), strict=True):
        if dx and dy:
            out.append(f"l{_tenth(dx)},{_tenth(dy)}")
        elif dx or dy:
            out.append(f"h{_tenth(dx)}" if dx else f"v{_tenth(dy)}")
    return "".join(out)


def _tenth(value: int) -> str:
    return f"{value / 10:.1f}".removesuffix(".0")


def _bars(mark: Bars, area: _Area) -> Iterator[str]:
    tips = mark.tips or ("",) * len(mark.left)
    sides = zip(
        area.x(mark.left),
        area.x(mark.right),
        area.y(mark.bottom),
        area.y(mark.top),
        tips,
        strict=True,
    )
    for left, right, bottom, top, tip in sides:
        gap = min(1.0, 0.1 * (right - left))
        yield (
            f'<rect class="bar-of" x="{left + gap:.1f}" y="{top:.1f}"'
            f' width="{right - left - 2 * gap:.1f}" height="{bottom - top:.1f}"{_tip(tip)}/>'
        )


def _dots(mark: Dots, area: _Area) -> Iterator[str]:
    x, y = area.x(mark.x), area.y(mark.y)
    for low, high, fixed, along in (
        (mark.x_low, mark.x_high, y, True),
        (mark.y_low, mark.y_high, x, False),
    ):
        if len(low):
            limit = area.wide if along else area.high
            ends = [np.clip((area.x if along else area.y)(edge), 0, limit) for edge in (low, high)]
            for first, last, at in zip(*ends, fixed, strict=True):
                yield (
                    _segment("spread-of", first, at, last, at)
                    if along
                    else _segment("spread-of", at, first, at, last)
                )
    for place in range(len(x)):
        size = mark.size[place] if mark.size else SIZE
        tip = _tip(mark.tips[place] if mark.tips else "")
        if mark.diamond:
            side, half = size * 0.85, size * 0.425
            yield (
                f'<rect class="dot" x="{x[place] - half:.1f}" y="{y[place] - half:.1f}"'
                f' width="{side:.1f}" height="{side:.1f}" transform="rotate(45 {x[place]:.1f}'
                f' {y[place]:.1f})"{tip}/>'
            )
        else:
            yield (
                f'<circle class="dot" cx="{x[place]:.1f}" cy="{y[place]:.1f}"'
                f' r="{size / 2:.1f}"{tip}/>'
            )
    if mark.texts:
        yield from _texts(mark, x, y, area)


def _texts(mark: Dots, x: np.ndarray, y: np.ndarray, area: _Area) -> Iterator[str]:
    """Beside their marks: those of one place in a row; a text upon another moves down until it
    is free.
    """
    at_place: dict[tuple[int, int], list[int]] = {}
    for place in (place for place, text in enumerate(mark.texts) if text):
        at_place.setdefault((round(x[place]), round(y[place])), []).append(place)
    occupied: list[tuple[float, float, float]] = []
    for _, places in sorted(at_place.items(), key=lambda one: one[0][1]):
        text = ", ".join(mark.texts[place] for place in places)
        wide = LETTER * len(text)
        left, at = float(x[places[0]]) + 9, float(y[places[0]]) - 5  # above a whisker
        if left + wide > area.wide + RIGHT:
            left = float(x[places[0]]) - 9 - wide
        for start, end, height in sorted(occupied, key=lambda one: one[2]):
            if start < left + wide and left < end and abs(at - height) < LINE:
                at = height + LINE
        occupied.append((left, left + wide, at))
        yield f'<text class="tick" x="{left:.1f}" y="{at:.1f}">{escape(text)}</text>'


def _tip(text: str) -> str:
    return f' data-tip="{escape(text)}"' if text else ""


def _cut(names: Sequence[str], width: int) -> list[str]:
    most = int(LONGEST * width / LETTER)
    return [name if len(name) <= most else name[: most - 1] + "…" for name in names]
