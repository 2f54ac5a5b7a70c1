"""Which hazards a campaign's group stands for, by its name. Needs nothing but the name, so that
reports can ask.
"""

from __future__ import annotations

import re

_ID = re.compile(r"[A-Z]\d\d")
_IDS = re.compile(r"(?:.*/)?([A-Z]\d\d(?:[-,][A-Z]\d\d)*)(?![A-Za-z0-9])")
"""An id, and the ids that a group's name begins with."""


def hazards_of(group: str) -> tuple[str, ...]:
    """Ids of the hazards that a group's name begins with, after the last "/"; none where it names
    none.

    So named are the plain groups of `expansion.expand`, and those that a campaign's author calls
    "B07,B08 no write" or "K15-K17 run level": a dash spans the ids between.
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
    """Kind of the faults of a group, what its author chose: the hazards that it stands for, or
    the group itself.
    """
    return ",".join(hazards_of(group)) or group
