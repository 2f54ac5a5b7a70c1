"""The tasks with targets: reach one after another and hold the tip there, or do levels of such
rounds.

A round of a level has the same targets each time. Its time runs from its first target to its last,
so that nobody is hurried between rounds. A level ends when its skill is shown several times in a
row, not after a number of repetitions. Surgical skills are taught in this way (Ritter, Scott, Surg.
Innov. 14, 2007). The scenario says which times are proficient.
"""

import itertools
import math

import numpy as np

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import Json
from ravenjax.train.protocol.world import Point, tissue_height
from ravenjax.train.robot import ArmName
from ravenjax.train.scenario.config import Levels, Reach
from ravenjax.train.tasks.base import Field, Task, Tips, Wish, round_point

LEAST_WAY_M = 0.005
"""The least distance from one target to the next, so that the tip must move."""
COLOURS = {"gold": "#d9a441", "green": "#1fae84"}


class ReachTask(Task):
    """Targets in a box over the tissue. Two arms take turns."""

    def __init__(self, settings: Reach, field: Field) -> None:
        super().__init__("reach", field)
        self.settings = settings
        rng = np.random.default_rng([field.seed, settings.seed, 1])
        self.targets: list[tuple[ArmName, Point]] = []
        before = dict(field.begin)
        for k in range(settings.targets):
            arm = field.arms[k % len(field.arms)]
            before[arm] = _draw(settings, field.middle, rng, before[arm])
            self.targets.append((arm, before[arm]))
        self.target = 0
        self._inside_ms = 0

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        arm, point = self.targets[self.target]
        if math.dist(tips[arm], point) > self.settings.tolerance_mm / 1e3:
            self._inside_ms = 0
            return
        self._inside_ms += 1
        if self._inside_ms <= self.settings.dwell_ms:
            return
        self._inside_ms = 0
        self.target += 1
        self.progress = self.target / len(self.targets)
        if self.target == len(self.targets):
            self._finish(tick)

    def restart(self) -> None:
        self._inside_ms = 0

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        if self.done or self.targets[self.target][0] != arm:
            return None
        return Wish(self.targets[self.target][1])

    def geometry(self) -> Json:
        targets = [
            {
                "number": k,
                "arm": arm,
                "at": round_point(at),
                "radius_m": self.settings.tolerance_mm / 1e3,
                "colour": COLOURS[arm],
            }
            for k, (arm, at) in enumerate(self.targets)
        ]
        return super().geometry() | {"targets": targets}


class LevelsTask(Task):
    """Rounds of targets in levels. A level ends after some rounds in a row within its time.

    Targets are numbered through all levels.
    """

    def __init__(self, settings: Levels, field: Field) -> None:
        super().__init__("levels", field)
        self.settings = settings
        self._first = [0, *itertools.accumulate(level.targets for level in settings.level[:-1])]
        self._level = 0
        self._in_a_row = 0
        # Durations of the rounds of each level.
        self._rounds_ms: list[list[int]] = [[] for _ in settings.level]
        # Tick at which the round's first target was reached.
        self._begun: int | None = None
        self._reach = self._round(0)
        self.target = 0

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        if self._published < 0:
            self._record_level(tick)
        # The round's own events are not passed on.
        self._reach._step(frame, tips, tick)
        if self._begun is None and self._reach.target != 0:
            self._begun = tick
        if self._reach.done:
            self._judge(tick)
        if not self.done:
            self.target = self._first[self._level] + self._reach.target

    def _round(self, number: int) -> ReachTask:
        level, field = self.settings.level[number], self._field
        arms = tuple(level.arms or field.arms)
        return ReachTask(level, field._replace(arms=arms, seed=field.seed + number))

    def _judge(self, tick: int) -> None:
        assert self._begun is not None
        level, levels = self._level, len(self.settings.level)
        took = tick - self._begun
        within = took <= 1000.0 * self.settings.level[level].within_s
        self._rounds_ms[level].append(took)
        self._in_a_row = self._in_a_row + 1 if within else 0
        self._begun = None
        if self._in_a_row == self.settings.in_a_row:
            self._level, self._in_a_row = level + 1, 0
        self.progress = (self._level + self._in_a_row / self.settings.in_a_row) / levels
        if self._level == levels:
            self._finish(tick)
            return
        self._reach = self._round(self._level)
        self._record_level(tick, took, within)

    def _record_level(self, tick: int, took_ms: int | None = None, within: bool = False) -> None:
        level = self.settings.level[self._level]
        self._record(
            tick,
            "level",
            level=self._level + 1,
            of=len(self.settings.level),
            title=level.title,
            within_s=level.within_s,
            in_a_row=self._in_a_row,
            needs=self.settings.in_a_row,
            took_ms=took_ms,
            within=within,
        )

    def restart(self) -> None:
        self._reach.restart()

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        return None if self.done else self._reach.wish(arm, tip)

    def geometry(self) -> Json:
        targets = [
            target | {"number": first + target["number"]}
            for level, first in enumerate(self._first)
            for target in self._round(level).geometry()["targets"]
        ]
        return super().geometry() | {"targets": targets}

    def result(self) -> Json:
        return super().result() | {
            "levels": len(self.settings.level),
            "levels_proficient": self._level,
            "rounds_s_of_level": [[ms / 1000.0 for ms in rounds] for rounds in self._rounds_ms],
        }


def _draw(
    settings: Reach, middle: tuple[float, float], rng: np.random.Generator, before: Point
) -> Point:
    """Draw a point that is not too near to `before`; in a small box the farthest of 20."""
    extent = settings.extent_mm / 1e3
    points = []
    for _ in range(20):
        x, y = (float(middle[axis] + rng.uniform(-extent, extent)) for axis in (0, 1))
        point = (x, y, tissue_height(x, y) + float(rng.uniform(*settings.height_mm)) / 1e3)
        if math.dist(point, before) > LEAST_WAY_M:
            return point
        points.append(point)
    return max(points, key=lambda point: math.dist(point, before))
