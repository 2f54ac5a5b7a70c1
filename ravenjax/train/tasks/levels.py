"""Levels to proficiency: rounds of targets until some in a row are within the time, then the next
level.

A round has the same targets each time, and its time runs from its first target to its last, so that
nobody is hurried between rounds. That training ends with a level of skill that is shown again at
once, not with a number of repetitions, is how surgical skills are taught (Ritter, Scott, Surg.
Innov. 14, 2007); which times are proficient, a scenario says.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.world import Point
from ravenjax.train.robot import ArmName
from ravenjax.train.scenario.config import Levels
from ravenjax.train.tasks.base import Event, Field, Task, Wish
from ravenjax.train.tasks.reach import ReachTask


class LevelsTask(Task):
    """One level after another. Targets are numbered through all levels."""

    def __init__(self, settings: Levels, field: Field) -> None:
        super().__init__("levels", field)
        self.settings = settings
        self._fields = [
            field._replace(arms=tuple(level.arms or field.arms), seed=field.seed + k)
            for k, level in enumerate(settings.level)
        ]
        self._first = [0, *itertools.accumulate(level.targets for level in settings.level[:-1])]
        self._level = 0
        self._in_a_row = 0
        self._rounds_ms: list[list[int]] = [[] for _ in settings.level]  # of each level
        self._begun: int | None = None  # tick at which the round's first target was reached
        self._reach = self._round(0)
        self.target = 0

    def _step(
        self, frame: Frame, tips: Mapping[ArmName, Point], tick: int, events: list[Event]
    ) -> None:
        if self._published < 0:
            events.append(self._event(tick))
        self._reach._step(frame, tips, tick, [])  # what it tells is the round's alone
        if self._begun is None and self._reach.target != 0:
            self._begun = tick
        if self._reach.done:
            self._judge(tick, events)
        if not self.done:
            self.target = self._first[self._level] + self._reach.target

    def _round(self, level: int) -> ReachTask:
        return ReachTask(self.settings.level[level], self._fields[level])

    def _judge(self, tick: int, events: list[Event]) -> None:
        """The round is over: once more, the next level, or the end."""
        assert self._begun is not None
        level, took = self._level, tick - self._begun
        within = took <= 1000.0 * self.settings.level[level].within_s
        self._rounds_ms[level].append(took)
        self._in_a_row = self._in_a_row + 1 if within else 0
        self._begun = None
        if self._in_a_row == self.settings.in_a_row:
            self._level, self._in_a_row = level + 1, 0
        self.progress = (self._level + self._in_a_row / self.settings.in_a_row) / len(
            self.settings.level
        )
        if self._level == len(self.settings.level):
            self._finish(tick, events)
            return
        self._reach = self._round(self._level)
        events.append(self._event(tick, took, within))

    def _event(self, tick: int, took_ms: int | None = None, within: bool = False) -> Event:
        """Which level, what it asks, and how the round before went."""
        level = self.settings.level[self._level]
        return {
            "tick": tick,
            "kind": "level",
            "level": self._level + 1,
            "of": len(self.settings.level),
            "title": level.title,
            "within_s": level.within_s,
            "in_a_row": self._in_a_row,
            "needs": self.settings.in_a_row,
            "took_ms": took_ms,
            "within": within,
        }

    def restart(self) -> None:
        super().restart()
        self._reach.restart()

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        return None if self.done else self._reach.wish(arm, tip)

    def geometry(self) -> dict[str, Any]:
        targets = [
            one | {"number": first + one["number"]}
            for level, first in enumerate(self._first)
            for one in self._round(level).geometry()["targets"]
        ]
        return super().geometry() | {"targets": targets}

    def result(self) -> dict[str, Any]:
        return super().result() | {
            "levels": len(self.settings.level),
            "levels_proficient": self._level,
            "rounds_s_of_level": [[ms / 1000.0 for ms in rounds] for rounds in self._rounds_ms],
        }
