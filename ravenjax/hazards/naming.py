"""Finds the hazards that a group of runs represents, and their titles, from the name of the group.

A report has no other information than this name.
"""

import re

from ravenjax.hazards import library
from ravenjax.vocabulary.robot import Robot

MAX_TITLES = 3
"""Largest number of titles that are listed for a group; further titles are counted."""
_ID = re.compile(r"[A-Z]\d\d")
_IDS = re.compile(r"(?:.*/)?([A-Z]\d\d(?:[-,][A-Z]\d\d)*)(?![A-Za-z0-9])")
"""Patterns of one id, and of the ids with which a group's name begins."""


def hazards_of(group: str) -> tuple[str, ...]:
    """Return the ids of hazards with which a group's name begins, after the last "/". Groups of
    `expansion.expand_group` have such names. An author may also choose names such as "B07,B08 no
    write", or "K15-K17 run level", which includes K16. The result is () without ids.
    """
    match = _IDS.match(group)
    if match is None:
        return ()
    ids = []
    for part in match[1].split(","):
        # One id, or the first and the last id of a range.
        first, *further = _ID.findall(part)
        last = further[-1] if further else first
        ids += [f"{first[0]}{number:02}" for number in range(int(first[1:]), int(last[1:]) + 1)]
    return tuple(ids)


def kind_of(group: str) -> str:
    """Return the kind of a group's faults: the ids of its hazards, or else its name."""
    return ",".join(hazards_of(group)) or group


def titles_of(group: str, robot: Robot) -> str:
    """Return the titles of the hazards in a group's name; "" without a known hazard."""
    names = hazards_of(group)
    titles = [row.title for row in library.all_hazards(robot) if row.id in names]
    more = f"; {len(titles) - MAX_TITLES} more" if len(titles) > MAX_TITLES else ""
    return "; ".join(titles[:MAX_TITLES]) + more
