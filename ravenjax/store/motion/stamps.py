"""Determines when the rows of a recording were sampled: the column of times, its unit, and whether
it is plausible.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError

NAMES = ("time", "t", "stamp", "timestamp")
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds per unit. A column holds times if its name is one of NAMES and a unit, such as `t_ms`."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 20_000.0
"""Plausible rates of recorders of hands. A rate outside most likely has another unit."""

RATES_AGREE = 0.05
"""Share by which a stated rate and the mean rate of time stamps may differ."""

BURSTS, LEAST_ROWS = 4.0, 20
"""Rows come in bursts if most follow one another BURSTS times faster than on average.

This is not checked for fewer than LEAST_ROWS rows.
"""


def time_columns(names: Iterable[str], stems: tuple[str, ...] = NAMES) -> list[str]:
    """Return the names that are times with a unit."""
    return [name for name in names for stem in stems for unit in UNITS if name == f"{stem}_{unit}"]


def seconds_since_first(values: np.ndarray) -> np.ndarray:
    """Return times since the first of them, in their unit.

    Integers are subtracted before they are converted, because nanoseconds since 1970 do not fit a
    double.
    """
    if values.dtype.kind in "iu":
        values = values.astype(np.int64)
    return (values - values[0]).astype(float)


def sample_times(
    path: Path, name: str | None, values: np.ndarray | None, rows: int, rate_hz: float | None
) -> tuple[np.ndarray | None, str, tuple[str, ...]]:
    """Return seconds [T] since the first row (None if rows are evenly spaced), their source in
    words, and notes.

    name, values: the column of times, if there is one. rate_hz: as the campaign states it. Raises
    UserError if neither the file nor the campaign states the times of rows, or if they contradict
    each other.
    """
    seconds = None
    if name is not None and values is not None:
        seconds = seconds_since_first(values) * UNITS[name.rpartition("_")[2]]
    if rate_hz is None and seconds is None:
        raise UserError(
            f"{path}: nothing says when its {rows} rows were sampled; expected a column time_s (or"
            " _ms, _us, _ns): rename the one that is the time. Or write the rate of the rows into"
            " the campaign: operator.rate_hz = 1000 if a row is a millisecond"
        )
    if rate_hz is None:
        return seconds, f"column {name}", ()
    clock = f"operator.rate_hz = {rate_hz:g}"
    if seconds is None:
        return None, clock, ()
    span, stated = float(seconds[-1] - seconds[0]), (rows - 1) / rate_hz
    if not abs(span - stated) <= RATES_AGREE * stated:
        mean = f"{(rows - 1) / span:.4g} rows a second" if span > 0 else "all rows at one time"
        raise UserError(
            f"{path}: {clock} makes {stated:.4g} s of {rows} rows, column {name} says {span:.4g} s"
            f" ({mean}); expected them to agree within {100 * RATES_AGREE:g} %. Write the rate of"
            " the recording, and operator.slow_down to replay it slower or faster; or drop the"
            " column"
        )
    note = (
        f"column {name} is not used, operator.rate_hz spaces rows evenly; it says {span:.3f} s in"
        " all"
    )
    return None, clock, (note,)


def require_plausible(path: Path, time_s: np.ndarray, clock: str, max_gap_s: float) -> None:
    """Raise UserError for stamps [T] that stand still, go back, come in bursts or have an
    implausible rate.
    """
    steps, span = np.diff(time_s), float(time_s[-1] - time_s[0])
    mean_hz = len(steps) / span if span > 0.0 else np.inf
    even = (
        "If they say when rows arrived, not when they were sampled, write operator.rate_hz ="
        f" {mean_hz:.6g}"
    )
    if (back := np.flatnonzero(steps < 0.0)).size:
        raise UserError(
            f"{path}: row {back[0] + 1}: time goes back by {-steps[back[0]]:.6g} s ({clock};"
            f" {_such_rows(back)}); expected it never to. Sort the rows, or cut the file there"
        )
    if (still := np.flatnonzero(steps == 0.0)).size:
        row = int(still[0]) + 1
        raise UserError(
            f"{path}: row {row} has the time of row {row - 1}, {time_s[row]:.6g} s ({clock};"
            f" {_such_rows(still)}); expected each row later than the one before. {even}"
        )
    median, lowest = float(np.median(steps)), min(LOWEST_HZ, 1.0 / max_gap_s)
    if all(hz > HIGHEST_HZ or hz < lowest for hz in (mean_hz, 1.0 / median)):
        raise UserError(
            f"{path}: by {clock} there are {mean_hz:.4g} rows a second, {span:.4g} s in all;"
            f" expected {lowest:g} to {HIGHEST_HZ:g} a second. If its unit is another, rename it:"
            " _s, _ms, _us or _ns"
        )
    if len(steps) >= LEAST_ROWS and median < 1.0 / (BURSTS * mean_hz):
        raise UserError(
            f"{path}: the stamps come in bursts: {clock} has half of the rows within"
            f" {median * 1e3:.3g} ms of the one before, but only {mean_hz:.4g} rows a second."
            f" {even}: rows are then evenly spaced"
        )


def _such_rows(rows: np.ndarray) -> str:
    return f"{len(rows)} such row{'s' if len(rows) > 1 else ''}"
