"""Titles of the library's hazards, for reports."""

from __future__ import annotations

from ravenjax.hazards import library, naming

MOST = 3
"""At most so many titles are listed for a group; the others are counted."""


def of_group(group: str) -> str:
    """Titles of the hazards that a group's name begins with; empty where it names none that is
    known.
    """
    names = naming.hazards_of(group)
    titles = [row.title for row in library.rows() if row.id in names]
    more = f"; {len(titles) - MOST} more" if len(titles) > MOST else ""
    return "; ".join(titles[:MOST]) + more
