"""Learning curves: the sessions of one person in one scenario, beside one another in a folder."""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import NamedTuple

from ravenjax.train.recording import folders

MEASURES = "dexterity"
"""Key of a session's summary."""


class Attempt(NamedTuple):
    """One session of the curve; None where it left no such number."""

    name: str
    score: float | None  # mean of its hazards
    reaction_ms: float | None  # median
    path_mm: float | None  # of all tips
    sparc: float | None  # mean of the tips


def attempts(folder: Path) -> list[Attempt]:
    """The sessions of the same person and scenario up to that of `folder`; none where the person
    is not named.
    """
    out: list[Attempt] = []
    sessions = folders.beside(folder.parent)
    here = next((one for one in sessions if one.path.name == folder.name), None)
    if here is None or not here.participant:
        return out
    for session in sessions[: sessions.index(here) + 1]:
        is_alike = (session.participant, session.scenario) == (here.participant, here.scenario)
        if not is_alike or MEASURES not in session.summary:
            continue
        hazards = session.summary.get("hazards") or {}
        arms = list(session.summary[MEASURES].get("arms", {}).values())
        smooth = [arm["sparc"] for arm in arms if arm.get("sparc") is not None]
        out.append(
            Attempt(
                session.path.name,
                hazards.get("score"),
                hazards.get("median_reaction_ms"),
                sum(arm.get("path_mm") or 0.0 for arm in arms) if arms else None,
                statistics.fmean(smooth) if smooth else None,
            )
        )
    return out
