"""Levels to proficiency: rounds of targets until some in a row are within the time, then the next
level.

A round has the same targets each time, and its time runs from its first target to its last, so that
nobody is hurried between rounds. That training ends with a level of skill that is shown again at
once, not with a number of repetitions, is how surgical skills are taught (Ritter, Scott, Surg.
Innov. 14, 2007); which times are proficient, a scenario says.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.world import Point
from ravenjax.train.scenario.config import Levels
from ravenjax.train.tasks.base import Event, Task, Wish
from ravenjax.train.tasks.reach import ReachTask


class LevelsTask(Task):
    """One level after another. Targets are numbered through all levels."""

    def __init__(
        self,
        settings: Levels,
        arms: Sequence[ArmName],
        begin: Mapping[ArmName, Point],
        middle: tuple[float, float],
        seed: int,
    ) -> None:
        super().__init__("levels", begin)
        self.settings = settings
        self._make = [
            functools.partial(ReachTask, level, level.arms or arms, begin, middle, seed + k)
            for k, level in enumerate(settings.level)
        ]
        self._first = [0, *itertools.accumulate(level.targets for level in settings.level[:-1])]
        self._level = 0
        self._in_a_row = 0
        self._rounds_ms: list[list[int]] = [
            [] for _ in settings.level
        ]  # how long each round of a level took
        self._begun: int | None = None  # tick at which the round's first target was reached
        self._reach = self._make[0]()
        self._told_level = False
        self.target = 0

    def _step(
        self, frame: Frame, tips: Mapping[ArmName, Point], tick: int, events: list[Event]
    ) -> None:
        if not self._told_level:
            self._told_level = True
            events.append(self._event(tick))
        self._reach._step(
            frame, tips, tick, []
        )  # the tips are known; what it tells is the round's alone
        if self._begun is None and self._reach.target != 0:
            self._begun = tick
        if self._reach.done:
            self._judge(tick, events)
        if not self.done:
            self.target = self._first[self._level] + self._reach.target

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
        self._reach = self._make[self._level]()
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
            for first, make in zip(self._first, self._make, strict=True)
            for one in make().geometry()["targets"]
        ]
        return super().geometry() | {"targets": targets}

    def result(self) -> dict[str, Any]:
        return super().result() | {
            "levels": len(self.settings.level),
            "levels_proficient": self._level,
            "rounds_s_of_level": [[ms / 1000.0 for ms in rounds] for rounds in self._rounds_ms],
        }
