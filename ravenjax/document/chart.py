"""What a chart shows: axes and marks in the units of the data. `svg` draws it on a page, `axes`
in print.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np

from ravenjax.document import ticks
from ravenjax.document.steps import Steps

EMPTY = np.zeros(0)
DASH = "–"
MANY = 3
"""Bands that can be told apart where they overlap; more of them are drawn fainter."""


@dataclasses.dataclass(frozen=True)
class ChartAxis:
    """One axis: what is shown, and how it is told."""

    title: str
    low: float
    high: float
    share: bool = False  # fractions, told in percent
    log: bool = False
    unit: str = ""  # of numbers in words: "ms"
    line: float | None = (
        None  # a value that is marked, as zero where values lie on both sides of it
    )
    names: tuple[
        str, ...
    ] = ()  # of places 0, 1, 2 ..., the first on top; then there are no numbers
    whole: bool = False  # counts

    def ticks(self, most: int) -> list[float]:
        """At most `most` round values within the axis; of names every one."""
        if self.names:
            return [float(place) for place in range(len(self.names))]
        values = (ticks.logarithmic if self.log else ticks.linear)(self.low, self.high, most)
        return [value for value in values if not self.whole or float(value).is_integer()]

    def labels(self, values: Sequence[float]) -> list[str]:
        """Words of ticks."""
        return list(self.names) if self.names else ticks.labels(values, self.share)

    def place(self, values: np.ndarray) -> np.ndarray:
        """0 at the low end, 1 at the high end; names run downwards."""
        if self.names:
            return 1.0 - (np.asarray(values, float) + 0.5) / len(self.names)
        ends = np.array([self.low, self.high])
        scale = np.log10 if self.log else np.asarray
        low, high = scale(ends)
        return (scale(np.asarray(values, float)) - low) / (high - low)

    def words(self, value: float) -> str:
        """A number with its unit; one decimal more than a tick of its size."""
        if not np.isfinite(value):
            return DASH
        if self.share:
            return f"{100 * value:.1f}{ticks.NARROW}%"
        text = f"{value:,.0f}" if abs(value) >= 100 or float(value).is_integer() else f"{value:.3g}"
        return f"{text} {self.unit}".rstrip().replace("-", "−")


@dataclasses.dataclass(frozen=True, eq=False)
class Curve:
    """A line, straight or in steps, and its band; arrays [points]."""

    name: str
    colour: str  # a name of the palette
    x: np.ndarray
    y: np.ndarray
    low: np.ndarray = dataclasses.field(default_factory=lambda: EMPTY)  # no band: empty
    high: np.ndarray = dataclasses.field(default_factory=lambda: EMPTY)
    step: bool = False  # each value holds until the next x
    dashed: bool = False
    visible: bool = True  # False: drawn when somebody asks for it
    in_legend: bool = True  # in the legend

    @staticmethod
    def of(points: Steps, name: str, colour: str, band: bool = True, visible: bool = True) -> Curve:
        """The curve of points that `steps` has made."""
        edges = (points.low, points.high) if band else (EMPTY, EMPTY)
        return Curve(name, colour, points.x, points.y, *edges, step=True, visible=visible)

    def at(self, x: float) -> tuple[float, float, float]:
        """Value and band at x; NaN outside of the curve and without a band."""
        if not len(self.x) or not self.x[0] <= x <= self.x[-1]:
            return np.nan, np.nan, np.nan
        parts = [
            part if len(part) else np.full(len(self.x), np.nan)
            for part in (self.y, self.low, self.high)
        ]
        if self.step:
            place = int(np.searchsorted(self.x, x, side="right")) - 1
            return tuple(float(part[place]) for part in parts)  # pyright: ignore[reportReturnType]
        return tuple(float(np.interp(x, self.x, part)) for part in parts)  # pyright: ignore[reportReturnType]


@dataclasses.dataclass(frozen=True, eq=False)
class Dots:
    """Marks with the intervals that they have; arrays [marks]."""

    name: str
    colour: str
    x: np.ndarray
    y: np.ndarray
    x_low: np.ndarray = dataclasses.field(default_factory=lambda: EMPTY)  # no intervals: empty
    x_high: np.ndarray = dataclasses.field(default_factory=lambda: EMPTY)
    y_low: np.ndarray = dataclasses.field(default_factory=lambda: EMPTY)
    y_high: np.ndarray = dataclasses.field(default_factory=lambda: EMPTY)
    size: tuple[float, ...] = ()  # diameters, px; () for 8
    texts: tuple[str, ...] = ()  # beside the marks
    tips: tuple[str, ...] = ()  # what each mark is, in words
    diamond: bool = False
    visible: bool = True
    in_legend: bool = True


@dataclasses.dataclass(frozen=True, eq=False)
class Bars:
    """Upright bars of bins; arrays [bins]."""

    name: str
    colour: str
    left: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    top: np.ndarray
    tips: tuple[str, ...] = ()
    visible: bool = True
    in_legend: bool = True


Mark: TypeAlias = Curve | Dots | Bars


@dataclasses.dataclass(frozen=True)
class Chart:
    """One chart. Marks of one name are shown and hidden together."""

    title: str
    x: ChartAxis
    y: ChartAxis
    marks: tuple[Mark, ...]
    height: int = 300  # px of the drawn area

    def legend(self) -> list[tuple[str, str, bool]]:
        """Name, colour and whether it is shown, of each thing in the legend."""
        entries: dict[str, tuple[str, str, bool]] = {}
        for mark in self.marks:
            if mark.in_legend and mark.name:
                entries.setdefault(mark.name, (mark.name, mark.colour, mark.visible))
        return list(entries.values())

    def words(self) -> str:
        """What it is, in one sentence, for who cannot see it."""
        names = [name for name, *_ in self.legend()]
        of = f", of {'; '.join(names)}" if names else ""
        return (
            f"Chart: {self.title}. {self.y.title} over {self.x.title}{of}. Its numbers are in the"
            " table below."
        )

    def numbers(self) -> list[Numbers]:
        """What it shows as tables, for who cannot see it."""
        curves = [mark for mark in self.marks if isinstance(mark, Curve) and mark.in_legend]
        out = [self._curves(curves)] if curves else []
        dots = [mark for mark in self.marks if isinstance(mark, Dots)]
        out += [self._dots(dots)] if dots else []
        bars = [mark for mark in self.marks if isinstance(mark, Bars)]
        return out + ([self._bars(bars)] if bars else [])

    def _curves(self, curves: Sequence[Curve]) -> Numbers:
        places = self.x.ticks(6)
        if self.x.high not in places and any(
            len(one.x) and one.x[-1] >= self.x.high for one in curves
        ):
            places.append(self.x.high)
        heads = [f"{self.x.title}: {self.x.words(place)}" for place in places[:1]]
        heads += [self.x.words(place) for place in places[1:]]
        rows = [(one.name, *(self._value(one.at(place)) for place in places)) for one in curves]
        return Numbers(("", *heads), rows)

    def _value(self, point: tuple[float, float, float]) -> str:
        value, low, high = point
        band = (
            f" ({self.y.words(low)} to {self.y.words(high)})"
            if np.isfinite(low) and np.isfinite(high)
            else ""
        )
        return f"{self.y.words(value)}{band}"

    def _dots(self, dots: Sequence[Dots]) -> Numbers:
        rows = [row for one in dots for row in self._marks(one)]
        return Numbers(("", self.x.title, self.y.title), rows)

    def _marks(self, one: Dots) -> Iterator[tuple[str, ...]]:
        for place, (x, y) in enumerate(zip(one.x, one.y, strict=True)):
            name = one.tips[place] if one.tips else one.name
            across = self._spread(self.x, x, one.x_low, one.x_high, place)
            up = (
                self.y.names[round(y)]
                if self.y.names
                else self._spread(self.y, y, one.y_low, one.y_high, place)
            )
            yield name, across, up

    @staticmethod
    def _spread(
        axis: ChartAxis, value: float, low: np.ndarray, high: np.ndarray, place: int
    ) -> str:
        words = axis.words(value)
        return (
            f"{words} ({axis.words(low[place])} to {axis.words(high[place])})"
            if len(low)
            else words
        )

    def _bars(self, bars: Sequence[Bars]) -> Numbers:
        rows = [
            (one.name, f"{self.x.words(left)} to {self.x.words(right)}", self.y.words(top - bottom))
            for one in bars
            for left, right, bottom, top in zip(
                one.left, one.right, one.bottom, one.top, strict=True
            )
        ]
        return Numbers(("", self.x.title, self.y.title), rows)


@dataclasses.dataclass(frozen=True)
class Numbers:
    """A table of words."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
