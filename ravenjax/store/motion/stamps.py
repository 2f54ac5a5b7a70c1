"""When the rows of a recording were sampled: which column says so, in which unit, and whether it
can be believed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError

NAMES = ("time", "t", "stamp", "timestamp")
UNITS = {
    "s": (1.0, ("s", "sec", "secs", "second", "seconds")),
    "ms": (1e-3, ("ms", "msec", "millis", "millisecond", "milliseconds")),
    "us": (1e-6, ("us", "usec", "micros", "microsecond", "microseconds")),
    "ns": (1e-9, ("ns", "nsec", "nanos", "nanosecond", "nanoseconds")),
}
"""Seconds in a unit, and the suffixes that mean it."""

KNOWN = {
    f"{name}_{word}": unit for name in NAMES for unit, (_, words) in UNITS.items() for word in words
}
"""Unit of each column name that is a time."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 20_000.0
"""Rates of recorders of hands: what lies outside has most likely another unit."""

RATES_AGREE = 0.05
"""A stated rate and the mean rate of time stamps may differ by this share."""

BURSTS, LEAST_ROWS = 4.0, 20
"""Rows come in bursts where most follow one another this many times faster than on average; not
told of fewer rows.
"""

_TOKENS = frozenset(
    (
        "t",
        "date",
        "datetime",
        "nanosec",
        "nanosecs",
        *(word for _, words in UNITS.values() for word in words),
    )
)


def time_columns(names: Iterable[str]) -> list[str]:
    """Those that are times with a unit."""
    return [name for name in names if name in KNOWN]


def looks_like_time(name: str) -> bool:
    """Whether a column's name speaks of time, with or without a unit."""
    lower = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
    return any(part in lower for part in ("time", "stamp", "clock")) or bool(
        _TOKENS & set(re.split(r"[^a-z0-9]+", lower))
    )


def of_columns(
    path: Path, columns: Mapping[str, np.ndarray], rows: int, rate_hz: float | None
) -> tuple[np.ndarray | None, str, tuple[str, ...]]:
    """Seconds [T] since the first row, where they come from in words, and notes; None where rows
    are even.

    columns: every one of the file that may be a time, by name. rate_hz: as the campaign states it.
    Raises UserError where neither the file nor the campaign says when rows were sampled, or they
    contradict.
    """
    names = time_columns(columns)
    dated = [name for name in columns if name in NAMES and columns[name].dtype.kind in "mM"]
    if len(names) + len(dated) > 1:
        raise UserError(
            f"{path}: columns {' and '.join([*names, *dated])} say the same; keep one of them"
        )
    name = next(iter([*names, *dated]), None)
    seconds = None if name is None else _seconds(path, name, columns[name])
    if rate_hz is not None:
        return None, f"operator.rate_hz = {rate_hz:g}", _overruled(path, name, seconds, rate_hz)
    if name is not None and seconds is not None:
        return seconds, f"column {name}", ()
    for other, values in columns.items():
        if looks_like_time(other) or _rises(values):
            raise UserError(_unknown(path, other, values))
    raise UserError(
        f"{path}: nothing says when its {rows} rows were sampled; expected a column time_s (or _ms,"
        " _us, _ns), or the rate of the rows in the campaign: write operator.rate_hz = 1000 if a"
        " row is a millisecond"
    )


def check(path: Path, time_s: np.ndarray, clock: str, max_gap_s: float) -> None:
    """UserError for stamps [T] that stand still, go back, come in bursts or have an implausible
    rate.
    """
    steps = np.diff(time_s)
    mean_hz = len(steps) / (time_s[-1] - time_s[0]) if time_s[-1] > time_s[0] else np.inf
    even = (
        "If they say when rows arrived, not when they were sampled, write operator.rate_hz ="
        f" {_rounded(mean_hz)}"
    )
    if (back := np.flatnonzero(steps < 0.0)).size:
        row = int(back[0]) + 1
        raise UserError(
            f"{path}: row {row}: time goes back by {-steps[back[0]]:.6g} s ({clock};"
            f" {_such(back.size)}); expected it never to. Sort the rows, or cut the file there"
        )
    if (still := np.flatnonzero(steps == 0.0)).size:
        row = int(still[0]) + 1
        hint = (
            "Drop the column if it says nothing, and write operator.rate_hz"
            if np.isinf(mean_hz)
            else even
        )
        raise UserError(
            f"{path}: row {row} has the time of row {row - 1}, {time_s[row]:.6g} s ({clock};"
            f" {_such(still.size)}); expected each row later than the one before. {hint}"
        )
    median = float(np.median(steps))
    lowest = min(LOWEST_HZ, 1.0 / max_gap_s)
    if all(hz > HIGHEST_HZ or hz < lowest for hz in (mean_hz, 1.0 / median)):
        raise UserError(
            f"{path}: by {clock} there are {mean_hz:.4g} rows a second,"
            f" {time_s[-1] - time_s[0]:.4g} s in all; expected {lowest:g} to {HIGHEST_HZ:g} a"
            f" second.{_unit_hint(clock, mean_hz)}"
        )
    if len(steps) >= LEAST_ROWS and median < 1.0 / (BURSTS * mean_hz):
        raise UserError(
            f"{path}: the stamps come in bursts: {clock} has half of the rows within"
            f" {median * 1e3:.3g} ms of the one before, but only {mean_hz:.4g} rows a second."
            f" {even}: rows are then evenly spaced"
        )


def _seconds(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    if values.dtype.kind in "mM":
        if name in KNOWN:
            raise UserError(
                f"{path}: column {name} holds dates or durations, expected numbers; call it "
                f"{name.rpartition('_')[0]}, without a unit, if they are to be used"
            )
        if (bad := np.flatnonzero(np.isnat(values))).size:
            raise UserError(
                f"{path}: row {bad[0]}, column {name}: no time, expected one in each row"
            )
        return (values - values[0]).astype("timedelta64[ns]").astype(np.int64) * 1e-9
    factor = UNITS[KNOWN[name]][0]
    if values.dtype.kind == "u":
        if int(values.max()) >= 2**63:
            raise UserError(f"{path}: column {name} has times beyond 2^63; expected numbers below")
        values = values.astype(np.int64)  # differences may be negative
    if values.dtype.kind == "i":
        return (values - values[0]).astype(
            float
        ) * factor  # nanoseconds since 1970 do not fit a double
    return (values - values[0]) * factor


def _overruled(
    path: Path, name: str | None, seconds: np.ndarray | None, rate_hz: float
) -> tuple[str, ...]:
    """Notes on a time column that is not used because the campaign states the rate; UserError
    where they contradict.
    """
    if name is None or seconds is None:
        return ()
    span, stated = float(seconds[-1] - seconds[0]), (len(seconds) - 1) / rate_hz
    if not abs(span - stated) <= RATES_AGREE * stated:
        mean = (
            f"{(len(seconds) - 1) / span:.4g} rows a second" if span > 0 else "all rows at one time"
        )
        raise UserError(
            f"{path}: operator.rate_hz = {rate_hz:g} makes {stated:.4g} s of {len(seconds)} rows,"
            f" column {name} says {span:.4g} s ({mean}); expected them to agree within"
            f" {100 * RATES_AGREE:g} %. Write the rate of the recording, and operator.slow_down to"
            " replay it slower or faster; or drop the column"
        )
    return (
        (
            f"column {name} is not used, operator.rate_hz spaces rows evenly; it says {span:.3f} s"
            " in all"
        ),
    )


def _unknown(path: Path, name: str, values: np.ndarray) -> str:
    what = "looks like time" if looks_like_time(name) else "rises from row to row as time does"
    if values.dtype.kind not in "if":
        holds = (
            f"{what} and does not hold numbers; write seconds since the first row into a column"
            " time_s"
        )
    else:
        step = float(np.median(np.diff(values.astype(float))))
        likely = {u: 1.0 / (step * f) for u, (f, _) in UNITS.items() if step > 0.0}
        likely = {u: hz for u, hz in likely.items() if LOWEST_HZ <= hz <= HIGHEST_HZ}
        options = ", ".join(f"time_{unit} ({hz:.4g} rows a second)" for unit, hz in likely.items())
        holds = (
            f"{what}, and is not known to say when rows were sampled, nor in which unit (a row adds"
            f" {step:.4g}). If it does, rename it"
            f" {options or 'time_s, time_ms, time_us or time_ns'}"
        )
    return (
        f"{path}: column {name!r} {holds}. If rows are even write their rate: operator.rate_hz ="
        " 1000"
    )


def _rises(values: np.ndarray) -> bool:
    """Whether numbers rise as time does. What counts rows one by one says nothing of time."""
    if values.dtype.kind not in "if" or len(values) < 3:
        return False
    steps = np.diff(values.astype(float))
    return bool((steps >= 0.0).all() and (steps > 0.0).mean() >= 0.5 and not (steps == 1.0).all())


def _unit_hint(clock: str, hz: float) -> str:
    name = clock.removeprefix("column ")
    if name not in KNOWN:
        return ""
    factor = UNITS[KNOWN[name]][0]
    fits = {
        unit: hz * factor / f
        for unit, (f, _) in UNITS.items()
        if LOWEST_HZ <= hz * factor / f <= HIGHEST_HZ
    }
    stem = name.rpartition("_")[0]
    options = " or ".join(
        f"{stem}_{unit} ({rate:.4g} rows a second)" for unit, rate in fits.items()
    )
    return f" If its unit is another, rename it {options}" if options else ""


def _such(rows: int) -> str:
    return "1 such row" if rows == 1 else f"{rows} such rows"


def _rounded(hz: float) -> str:
    return f"{hz:.6g}"
