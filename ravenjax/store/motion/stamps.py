"""Determines the time of each row of a recording, from the column of times and its unit.

Implausible times are refused.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError
from ravenjax.store.motion.options import MOST_GAP_S, ReplayOptions

NAMES = ("time", "t", "stamp", "timestamp")
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds per unit. A column of times has one of NAMES and a unit as name, such as `t_ms`."""

LOWEST_HZ, HIGHEST_HZ = 10.0, 20_000.0
"""Plausible sample rates of hand motions. Outside, the unit of the times is most likely wrong."""

USUAL_STEPS, LEAST_GAP_S = 3.0, 0.02
"""A time step is a gap if it exceeds LEAST_GAP_S and USUAL_STEPS times the median step."""

RATES_AGREE = 0.05
"""Largest relative difference between the rate that a user states and that of the time stamps."""

BURSTS, LEAST_ROWS = 4.0, 20
"""Rows come in bursts if the median time step is BURSTS times shorter than the mean step. The mean
does not include the few longest steps. Fewer than LEAST_ROWS rows are not checked.
"""


def time_columns(names: Iterable[str], stems: tuple[str, ...] = NAMES) -> list[str]:
    """Return those of `names` that consist of a stem and a unit of time, such as `t_ms`."""
    return [name for name in names for stem in stems for unit in UNITS if name == f"{stem}_{unit}"]


def times_since_first(values: np.ndarray) -> np.ndarray:
    """Return the times `values` relative to the first, in the same unit. Integers are subtracted
    before the conversion to double precision, which cannot represent nanoseconds since 1970
    exactly.
    """
    if values.dtype.kind in "iu":
        values = values.astype(np.int64)
    return (values - values[0]).astype(float)


def sample_times(
    path: Path, clock: str, seconds: np.ndarray | None, rows: int, options: ReplayOptions
) -> tuple[np.ndarray | None, str, tuple[str, ...]]:
    """Return the times of rows [T], s (None if rows are evenly spaced), their source, and notes.
    clock, seconds: source and times in the file, if it has any. Raise UserError if neither the file
    nor `options.rate_hz` gives the times of rows, or if they contradict each other.
    """
    rate_hz = options.rate_hz
    if rate_hz is None and seconds is None:
        raise UserError(
            f"{path}: the times of its {rows} rows are unknown; expected a column time_s (or"
            " _ms, _us, _ns). Rename the column with the times, or write the number of rows per"
            f" second, such as {options.written('rate_hz', 1000)} for one row per millisecond"
        )
    if rate_hz is None:
        return seconds, clock, ()
    # The option as the user writes it, for messages.
    rate_text = options.written("rate_hz", f"{rate_hz:g}")
    if seconds is None:
        return None, rate_text, ()
    span, stated = float(seconds[-1] - seconds[0]), (rows - 1) / rate_hz
    if not abs(span - stated) <= RATES_AGREE * stated:
        slow_down = options.written("slow_down", "2.0")
        slower = f". To replay more slowly, write {slow_down}" if slow_down else ""
        mean = f"{(rows - 1) / span:.4g} rows a second" if span > 0 else "all rows at one time"
        raise UserError(
            f"{path}: {rate_text} and {clock} disagree on the length of {rows} rows: {stated:.4g} s"
            f" and {span:.4g} s ({mean}). Expected at most {100 * RATES_AGREE:g} % difference."
            f" Correct the stated rate, or remove the times from the file{slower}"
        )
    note = f"{clock} is not used, because {rate_text} spaces rows evenly; it spans {span:.3f} s"
    return None, rate_text, (note,)


def require_plausible(path: Path, time_s: np.ndarray, clock: str, options: ReplayOptions) -> None:
    """Raise UserError for times [T] that repeat, decrease, come in bursts or at a strange rate."""
    if len(time_s) < 2:
        raise UserError(f"{path}: {clock}: {len(time_s)} samples; expected at least 2 samples")
    steps, span = np.diff(time_s), float(time_s[-1] - time_s[0])
    mean_hz = len(steps) / span if span > 0.0 else np.inf
    item = "row" if clock.startswith("column") else "message"
    even = "."
    if LOWEST_HZ <= mean_hz <= HIGHEST_HZ:
        even = (
            ". If these are times of arrival, not of sampling, write"
            f" {options.written('rate_hz', f'{mean_hz:.6g}')}: rows are then evenly spaced"
        )
    sensors = options.written("sensors", "{ column = 'tool', gold = 'left' }")
    if sensors and item == "row":
        even = f". If a column names the sensor of each row, write {sensors}{even}"
    if (back := np.flatnonzero(steps < 0.0)).size:
        raise UserError(
            f"{path}: {item} {back[0] + 1}: time goes back by {-steps[back[0]]:.6g} s ({clock};"
            f" {_such_rows(back)}); expected no step back. {_correction(time_s, back, item)}"
        )
    if (still := np.flatnonzero(steps == 0.0)).size:
        row = int(still[0]) + 1
        raise UserError(
            f"{path}: {item} {row} has the time of {item} {row - 1}, {time_s[row]:.6g} s ({clock};"
            f" {_such_rows(still)}); expected each later than the one before{even}"
        )
    median, lowest = float(np.median(steps)), min(LOWEST_HZ, 1.0 / options.max_gap_s)
    if all(hz > HIGHEST_HZ or hz < lowest for hz in (mean_hz, 1.0 / median)):
        raise UserError(
            f"{path}: according to {clock} there are {mean_hz:.4g} rows a second, {span:.4g} s in"
            f" all; expected {lowest:g} to {HIGHEST_HZ:g} a second. If the unit is wrong, rename"
            " the column: _s, _ms, _us or _ns"
        )
    row = int(np.argmax(steps))
    if steps[row] > MOST_GAP_S:
        raise UserError(
            f"{path}: gap of {steps[row]:.3f} s after {item} {row} ({clock}); expected at most"
            f" {MOST_GAP_S:g} s: the clock was probably set. Cut the file there"
        )
    # Few long steps are gaps, not bursts.
    most = np.sort(steps)[: -max(2, len(steps) // 100)]
    if len(steps) >= LEAST_ROWS and median < most.mean() / BURSTS:
        raise UserError(
            f"{path}: the time stamps come in bursts: according to {clock}, half of the time steps"
            f" are at most {median * 1e3:.3g} ms, but there are only {mean_hz:.4g} rows per second"
            f"{even}"
        )


def find_gaps(time_s: np.ndarray) -> list[tuple[int, float, float]]:
    """Return (row before the gap, begin in s, end in s) for every gap in the times [T]."""
    steps = np.diff(time_s)
    rows = np.flatnonzero(steps > max(USUAL_STEPS * float(np.median(steps)), LEAST_GAP_S))
    return [(row, float(time_s[row]), float(time_s[row + 1])) for row in rows.tolist()]


def _correction(time_s: np.ndarray, back: np.ndarray, item: str) -> str:
    """Return advice for times [T] that go back after the rows `back`. item: "row" or "message"."""
    if back.size > len(time_s) // 20:
        return f"Sort the {item}s by time"
    row = int(back[0])
    earlier, later = time_s[max(row - 1, 0)], time_s[min(row + 4, len(time_s) - 1)]
    # First case: only the time of `row` is wrong. Second case: at most three times after `row` are
    # wrong. After a clock was set back, in contrast, many later times are below the time of `row`.
    if time_s[row + 1] > earlier or time_s[row] < later:
        return f"Remove the {item}s with wrong times, or correct their times"
    return "Cut the file there"


def _such_rows(rows: np.ndarray) -> str:
    return f"{len(rows)} such row{'s' if len(rows) > 1 else ''}"
