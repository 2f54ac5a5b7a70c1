"""Titles of the library's hazards, read without checking its rows, so that reports can ask."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources

from ravenjax.hazards import naming

MOST = 3
"""Titles told of one group; of more, the number."""


def of_group(group: str) -> str:
    """Titles of the hazards that a group's name begins with; empty where it names none that is
    known.
    """
    titles = [every()[name] for name in naming.hazards_of(group) if name in every()]
    more = f"; {len(titles) - MOST} more" if len(titles) > MOST else ""
    return "; ".join(titles[:MOST]) + more


@cache
def every() -> dict[str, str]:
    """Id -> title."""
    folder = resources.files("ravenjax.hazards") / "data"
    files = [file for file in folder.iterdir() if file.name.startswith("L")]
    rows = [
        row for file in files for row in tomllib.loads(file.read_text(encoding="utf-8"))["hazard"]
    ]
    return {row["id"]: row["title"] for row in rows}
