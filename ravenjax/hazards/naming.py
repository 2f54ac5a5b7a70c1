"""Finds the hazards that a group of runs represents, and their titles, from the name of the group.

A report has no other information than this name.
"""

import re

from ravenjax.hazards import library

MOST = 3
"""Largest number of titles that are listed for a group; further titles are counted."""
_ID = re.compile(r"[A-Z]\d\d")
_IDS = re.compile(r"(?:.*/)?([A-Z]\d\d(?:[-,][A-Z]\d\d)*)(?![A-Za-z0-9])")
"""Patterns of one id, and of the ids with which a group's name begins."""


def hazards_of(group: str) -> tuple[str, ...]:
    """Return the ids with which a group's name begins, after the last "/"; () if it has none.

    The plain groups of `expansion.expand_group` have such names. So have groups that a campaign's
    author calls "B07,B08 no write" or "K15-K17 run level": a dash includes the ids between.
    """
    match = _IDS.match(group)
    if match is None:
        return ()
    ids: list[str] = []
    for part in match[1].split(","):
        first, *rest = _ID.findall(part)
        last = rest[-1] if rest else first
        ids += [f"{first[0]}{number:02}" for number in range(int(first[1:]), int(last[1:]) + 1)]
    return tuple(ids)


def kind_of(group: str) -> str:
    """Return the kind of a group's faults, an author's choice: its hazards, or the group itself."""
    return ",".join(hazards_of(group)) or group


def titles_of(group: str) -> str:
    """Return the titles of these hazards; "" if the name begins with no known hazard."""
    names = hazards_of(group)
    titles = [row.title for row in library.all_hazards() if row.id in names]
    more = f"; {len(titles) - MOST} more" if len(titles) > MOST else ""
    return "; ".join(titles[:MOST]) + more
