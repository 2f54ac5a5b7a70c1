"""Writes numbers and tables of the findings of a study as Markdown."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.report import wording
from ravenjax.stats.intervals import Estimate
from studies.study import StudyEstimate

BY_DEFINITION = StudyEstimate(math.nan, of="by definition")
"""Replaces a number that the definitions alone decide and that is no finding."""


def cell(value: str | float | None) -> str:
    """Write a word, or three significant digits; a dash for an unknown number or infinity."""
    if isinstance(value, str):
        return value
    return wording.DASH if value is None else wording.format_number(value)


def span(low: float | None, high: float | None) -> str:
    """Write a range: `0.7 to 2.5`. An infinite end is null in a record."""
    if low is None or high is None:
        return f"at most {cell(high)}" if low is None else f"at least {cell(low)}"
    return cell(low) if low == high else f"{cell(low)} to {cell(high)}"


def with_interval(estimate: Mapping[str, Any], unit: str = "") -> str:
    """Write an estimate of findings.json with its interval, if any: `0.51 mm (0.43 to 0.58)`."""
    text = f"{cell(estimate['value'])} {unit}".rstrip()
    if estimate["low"] is None or estimate["high"] is None:
        return text
    return f"{text} ({span(estimate['low'], estimate['high'])})"


def counted_over(estimate: Mapping[str, Any]) -> str:
    """Write what an estimate was counted over or read from: `36 segments`; "" if unknown."""
    count = f"{wording.format_count(estimate['n'])} " if estimate["n"] else ""
    return f"{count}{estimate['of']}".rstrip()


def escaped(value: str | float | None) -> str:
    """Write a value so that it stays in one cell."""
    return " ".join(cell(value).split()).replace("|", r"\|")


# --- cells of a study's tables ---


def percent(share: StudyEstimate) -> str:
    """Write 63.2 % (60.1 to 66.4 %) of 812."""
    if share.of == BY_DEFINITION.of:
        return wording.DASH
    if not share.n:
        return "no runs"
    text, low, high = map(wording.format_percent, (share.value, share.low, share.high))
    ends = f" ({low} to {high})" if np.isfinite(share.low) else ""
    return f"{text}{ends} of {wording.format_count(share.n)}"


def plain(value: StudyEstimate | Estimate, digits: int = 3) -> str:
    """Write 12 (10 to 15); a dash if unknown."""
    if not np.isfinite(value.value):
        return wording.DASH
    ends = value.value, value.low, value.high
    text, low, high = (wording.format_number(end, digits) for end in ends)
    return f"{text} ({low} to {high})" if np.isfinite([value.low, value.high]).any() else text


def hourly(rate: StudyEstimate) -> str:
    """Write 0.8 (0 to 2.1); 3 in 4.0 h."""
    count = wording.format_count(rate.n)
    return f"{plain(rate)}; {count} in {rate.of.rpartition(' in ')[2]}"


def quartiles(values: np.ndarray) -> str:
    """Write the median (first to third quartile)."""
    if not len(values):
        return wording.DASH
    low, middle, high = map(wording.format_number, np.percentile(values, [25, 50, 75]).tolist())
    return f"{middle} ({low} to {high})"
