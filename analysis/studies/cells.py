"""Writes numbers and tables of findings as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ravenjax.report import wording


def number(value: float | None) -> str:
    """Write three significant digits; a dash for NaN or infinity."""
    return wording.DASH if value is None else wording.format_number(value)


def span(low: float | None, high: float | None) -> str:
    """Write a range: `0.7 to 2.5`. An infinite end is null in a record."""
    if low is None or high is None:
        return f"at most {number(high)}" if low is None else f"at least {number(low)}"
    return number(low) if low == high else f"{number(low)} to {number(high)}"


def with_interval(estimate: Mapping[str, Any], unit: str = "") -> str:
    """Write an estimate of findings.json with its interval: `0.51 mm (0.43 to 0.58)`. Without an
    interval there are no brackets.
    """
    text = f"{number(estimate['value'])} {unit}".rstrip()
    if estimate["low"] is None or estimate["high"] is None:
        return text
    return f"{text} ({span(estimate['low'], estimate['high'])})"


def counted_over(estimate: Mapping[str, Any]) -> str:
    """Write what an estimate was counted over or read from: `36 segments`; "" if unknown."""
    return (
        f"{wording.format_count(estimate['n'])} {estimate['of']}".rstrip()
        if estimate["n"]
        else estimate["of"]
    )


def cell(value: str | float | None) -> str:
    """Write a cell of a table of findings."""
    return value if isinstance(value, str) else number(value)


def table(columns: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a Markdown table."""
    heads = [escaped(column) for column in columns]
    body = ["| " + " | ".join(map(escaped, row)) + " |" for row in rows]
    return "\n".join(["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), *body])


def escaped(text: str) -> str:
    """Escape text so that it stays in one cell."""
    return " ".join(text.split()).replace("|", r"\|")
