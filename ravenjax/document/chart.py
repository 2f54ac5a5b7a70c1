"""Describes a chart as data: axes, and points and lines in the units of the data.

The module `drawing` draws a chart.
"""

import dataclasses
import json
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.document.numbers import DASH, NARROW, format_number, format_percent

Bounds: TypeAlias = np.ndarray | tuple[float, ...]
RESOLUTION = 1 / 400
"""Steps of a curve that are smaller than this fraction of its height may be merged."""


def round_values(low: float, high: float, count: int, *, log: bool = False) -> list[float]:
    """Return about `count` round numbers from low to high, or fewer.

    If the ends are not round numbers, the list contains one number beyond each end.
    """
    from matplotlib.ticker import LogLocator, MaxNLocator

    locator = LogLocator(numticks=count) if log else MaxNLocator(count, steps=[1, 2, 2.5, 5, 10])
    return [float(value) for value in locator.tick_values(low, high)]


@dataclasses.dataclass(frozen=True)
class ChartAxis:
    """One axis of a chart: its title, its range, and the format of its values."""

    title: str
    low: float
    high: float
    share: bool = False  # values are fractions, written in percent
    log: bool = False
    unit: str = ""  # unit of the numbers, such as "ms"
    line: float | None = None  # marked value, such as zero if values lie on both sides of it
    # Names of the positions 0, 1, 2 ..., which replace the numbers. The first is on top.
    names: tuple[str, ...] = ()

    def label(self, value: float) -> str:
        """Return the text of a tick: 12,000; 0.05; as a share 5 %."""
        text = f"{100 * value if self.share else value:,.8g}".replace("-", "−")
        return f"{text}{NARROW}%" if self.share else text

    def words(self, value: float) -> str:
        """Return a number with its unit as text; a dash if it is not finite."""
        if not np.isfinite(value):
            return DASH
        if self.share:
            return format_percent(value)
        return f"{format_number(value)} {self.unit}".rstrip()

    def words_with_interval(self, value: float, low: float, high: float) -> str:
        """Return a number with its interval, if it has one."""
        words = self.words(value)
        if not (np.isfinite(low) and np.isfinite(high)):
            return words
        return f"{words} ({self.words(low)} to {self.words(high)})"


@dataclasses.dataclass(frozen=True, eq=False)
class _Series:
    # What curves and dots have in common.
    name: str
    colour: str  # name of a colour of the palette
    x: np.ndarray
    y: np.ndarray
    _: dataclasses.KW_ONLY
    visible: bool = True  # False: hidden until the reader selects it
    in_legend: bool = True


@dataclasses.dataclass(frozen=True, eq=False)
class Curve(_Series):
    """A line, straight or in steps, and its band; arrays [points]."""

    # Empty: the curve has no band.
    low: Bounds = ()
    high: Bounds = ()
    step: bool = False  # each value holds until the next x
    dashed: bool = False

    @staticmethod
    def steps(
        name: str,
        colour: str,
        x: ArrayLike,
        y: ArrayLike,
        low: ArrayLike = (),
        high: ArrayLike = (),
        *,
        start: float | None = None,
        end: float | None = None,
    ) -> "Curve":
        """Return a step curve without points that cannot be distinguished from the point before.

        The first and the last point are kept. x [n] must not decrease. `start`: smallest x, because
        a logarithmic axis has no zero; the curve has there the value of the last point with smaller
        x. `end`: the last value is continued to `end`.
        """
        across = np.asarray(x, float)
        values = np.stack([np.asarray(part, float) for part in (y, low, high) if np.size(part)])
        if start is not None:
            first = max(0, int(np.searchsorted(across, start, side="right")) - 1)
            across, values = np.maximum(across[first:], start), values[:, first:]
        # The largest |y|; if all y are 0, the largest bound; if all bounds are 0 too, 1.
        height = float(np.abs(values[0]).max() or np.nanmax(np.abs(values))) or 1.0
        # Values in the same interval of the height look equal.
        interval = np.floor(values / (RESOLUTION * height))
        is_kept = np.concatenate([[True], (np.diff(interval, axis=1) != 0).any(axis=0)])
        is_kept[-1] = True
        across, values = across[is_kept], values[:, is_kept]
        if end is not None and end > across[-1]:
            across, values = np.append(across, end), np.hstack([values, values[:, -1:]])
        return Curve(name, colour, across, *values, step=True)

    def at(self, x: float) -> tuple[float, float, float]:
        """Return the value at x and the ends of its band; NaN outside of the curve."""
        if not len(self.x) or not self.x[0] <= x <= self.x[-1]:
            return np.nan, np.nan, np.nan
        # The last point at or before x.
        index = int(np.searchsorted(self.x, x, side="right")) - 1
        value, low, high = (
            float(part[index] if self.step else np.interp(x, self.x, part)) if len(part) else np.nan
            for part in (self.y, self.low, self.high)
        )
        return value, low, high


@dataclasses.dataclass(frozen=True, eq=False)
class Dots(_Series):
    """Marks of a chart, perhaps with intervals; arrays [marks]."""

    # Empty: the marks have no intervals.
    x_low: Bounds = ()
    x_high: Bounds = ()
    y_low: Bounds = ()
    y_high: Bounds = ()
    size: tuple[float, ...] = ()  # diameters, px; () means 8
    texts: tuple[str, ...] = ()  # labels beside the marks
    tips: tuple[str, ...] = ()  # description of each mark
    diamond: bool = False


Mark: TypeAlias = Curve | Dots


class Numbers(NamedTuple):
    """A table of words."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


@dataclasses.dataclass(frozen=True)
class Chart:
    """One chart. Marks that share a name are shown and hidden together."""

    title: str
    x: ChartAxis
    y: ChartAxis
    marks: tuple[Mark, ...]
    height: int = 300  # height of the drawn area, px

    def legend(self) -> list[tuple[str, str, bool]]:
        """Return name, colour and visibility of each entry of the legend."""
        entries: dict[str, tuple[str, str, bool]] = {}
        for mark in self.marks:
            if mark.in_legend and mark.name:
                entries.setdefault(mark.name, (mark.name, mark.colour, mark.visible))
        return list(entries.values())

    def words(self) -> str:
        """Return one sentence that describes the chart to a reader who cannot see it."""
        names = [name for name, *_ in self.legend()]
        of = f", of {'; '.join(names)}" if names else ""
        what = f"{self.title}. {self.y.title} over {self.x.title}{of}"
        return f"Chart: {what}. Its numbers are in the table below."

    def values(self) -> str:
        """Return the axes and the points of each curve as JSON, for the page's script."""
        keys, curves = ("title", "low", "high", "log", "share", "unit"), []
        x_axis, y_axis = ({key: getattr(axis, key) for key in keys} for axis in (self.x, self.y))
        for mark in self.marks:
            if isinstance(mark, Curve) and mark.in_legend:
                x, y = ([float(f"{value:.5g}") for value in part] for part in (mark.x, mark.y))
                curves.append({"name": mark.name, "step": mark.step, "x": x, "y": y})
        content = {"x": x_axis, "y": y_axis, "curves": curves}
        return json.dumps(content, allow_nan=False, separators=(",", ":"))

    def numbers(self) -> list[Numbers]:
        """Return the chart's numbers as tables, for a reader who cannot see it."""
        heads = ("", self.x.title, self.y.title)
        tables = [
            self._curve_numbers([mark for mark in self.marks if isinstance(mark, Curve)]),
            Numbers(heads, [row for mark in self.marks for row in self._dot_rows(mark)]),
        ]
        return [table for table in tables if table.rows]

    def _curve_numbers(self, curves: Sequence[Curve]) -> Numbers:
        # Returns the table below the chart: each curve at up to seven round values of x.
        axis, curves = self.x, [curve for curve in curves if curve.in_legend]
        round_numbers = round_values(axis.low, axis.high, 6, log=axis.log)
        positions = [x for x in round_numbers if axis.low <= x <= axis.high]
        reaches_end = any(len(curve.x) and curve.x[-1] >= axis.high for curve in curves)
        if axis.high not in positions and reaches_end:
            positions.append(axis.high)
        heads = [axis.words(x) for x in positions]
        if heads:
            heads[0] = f"{axis.title}: {heads[0]}"
        write = self.y.words_with_interval
        rows = [(curve.name, *(write(*curve.at(x)) for x in positions)) for curve in curves]
        return Numbers(("", *heads), rows)

    def _dot_rows(self, mark: Mark):
        # Yields the rows of the text table that describes a chart's dots for screen readers.
        if not isinstance(mark, Dots):
            return
        no_interval = np.full(len(mark.x), np.nan)
        parts = mark.x, mark.x_low, mark.x_high, mark.y, mark.y_low, mark.y_high
        columns = [part if len(part) else no_interval for part in parts]
        names = mark.tips or (mark.name,) * len(mark.x)
        for name, x, x_low, x_high, y, y_low, y_high in zip(names, *columns, strict=True):
            position_name = self.y.names[round(y)] if self.y.names else ""
            words = position_name or self.y.words_with_interval(y, y_low, y_high)
            yield name, self.x.words_with_interval(x, x_low, x_high), words
