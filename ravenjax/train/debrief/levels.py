"""How far a trainee came on the levels of a session, and how long each round took."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class LevelResult(NamedTuple):
    """One level of [task] kind = "levels"."""

    number: int  # from 1
    title: str
    targets: int
    within_s: float  # s, that a round may take
    rounds_s: tuple[float, ...]  # s, of each round, in their order
    proficient: bool

    def late(self, took_s: float) -> bool:
        """Whether a round took longer than it may."""
        return took_s > self.within_s


def results(header: Mapping[str, Any]) -> tuple[LevelResult, ...]:
    """Of each level, from session.json; none where the task has no levels, or the session never
    ended.
    """
    scenario, task = header.get("scenario"), (header.get("summary") or {}).get("task") or {}
    rounds = task.get("rounds_s_of_level")
    if not isinstance(scenario, Mapping) or not rounds:
        return ()
    levels = scenario["task"]["level"]
    return tuple(
        LevelResult(
            number=number,
            title=level.get("title", ""),
            targets=level["targets"],
            within_s=level["within_s"],
            rounds_s=tuple(took),
            proficient=number <= task["levels_proficient"],
        )
        for number, (level, took) in enumerate(zip(levels, rounds, strict=True), start=1)
    )
