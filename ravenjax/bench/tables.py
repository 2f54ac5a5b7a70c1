"""Rows of numbers as tables of text, and as a page of Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

TITLES = {
    "machine": "Machine",
    "shell": "From the shell",
    "engines": "Engines: full ticks a second",
    "cores": "Cores: full ticks a second",
    "devices": "GPUs: full ticks a second",
    "fault_times": "Runs of 10 s by when their fault strikes",
    "campaigns": "Growth with the number of runs",
    "peers": "Peers: rigid-body steps a second of the same arm",
    "ratios": "Ratios, each at its best",
    "absent": "What was not measured",
    "clocks": "Time that each part took",
    "beside": "Two checkouts, seconds",
}
Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, columns, rows."""


def make_tables(found: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[Table]:
    """Each table of which there are rows; a column for each key."""
    tables = []
    for name, title in TITLES.items():
        if rows := found.get(name):
            keys = list(dict.fromkeys(key for row in rows for key in row))
            cells = [tuple(_text(row.get(key)) for key in keys) for row in rows]
            tables.append((title, tuple(key.replace("_", " ") for key in keys), cells))
    return tables


def write_markdown(title: str, command: str, tables: Sequence[Table]) -> str:
    """A page of tables."""
    parts = [f"# {title}", f"Written by `{command}`."]
    for name, columns, rows in tables:
        lines = [" | ".join(row) for row in (columns, ("---",) * len(columns), *rows)]
        parts += [f"## {name}", "\n".join(f"| {line} |" for line in lines)]
    return "\n\n".join(parts) + "\n"


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    if isinstance(value, list) and value and isinstance(value[0], float):
        return f"{len(value)} times, {_text(min(value))} to {_text(max(value))}"
    if isinstance(value, list):
        return "; ".join(value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(one)}" for key, one in value.items())
    return str(value).replace("|", "\\|")
