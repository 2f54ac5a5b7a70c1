"""Titles of the library's hazards, for reports."""

from __future__ import annotations

from ravenjax.hazards import library, naming

MOST = 3
"""Largest number of titles that are listed for a group; further titles are counted."""


def of_group(group: str) -> str:
    """Return the titles of the hazards with which a group's name begins; "" if it names no known
    hazard.
    """
    names = naming.hazards_of(group)
    titles = [row.title for row in library.all_hazards() if row.id in names]
    more = f"; {len(titles) - MOST} more" if len(titles) > MOST else ""
    return "; ".join(titles[:MOST]) + more
