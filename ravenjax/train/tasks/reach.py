"""Reach one target after another and hold the tip there for a moment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.world import Point, surface
from ravenjax.train.robot import ArmName
from ravenjax.train.scenario.config import Reach
from ravenjax.train.tasks.base import Event, Field, Task, Wish, mean_ms, rounded

LEAST_WAY_M = 0.005
"""From one target to the next: less would be reached by holding still."""
COLOURS = {"gold": "#d9a441", "green": "#1fae84"}


class ReachTask(Task):
    """Targets anywhere in a box over the tissue; with two arms they alternate."""

    def __init__(self, settings: Reach, field: Field) -> None:
        super().__init__("reach", field)
        self.settings = settings
        rng = np.random.default_rng([field.seed, settings.seed, 1])
        self.targets: list[tuple[ArmName, Point]] = []
        before = dict(field.begin)
        for k in range(settings.targets):
            arm = field.arms[k % len(field.arms)]
            point = _draw(settings, field.middle, rng, before[arm])
            before[arm] = point
            self.targets.append((arm, point))
        self.target = 0
        self._tolerance_m = settings.tolerance_mm / 1e3
        self._inside = 0  # ms
        self._since = 0  # tick at which the present target was given
        self._times: list[int] = []
        self._straight_mm = 0.0
        self._from = dict(field.begin)

    def _step(
        self, frame: Frame, tips: Mapping[ArmName, Point], tick: int, events: list[Event]
    ) -> None:
        arm, point = self.targets[self.target]
        if math.dist(tips[arm], point) > self._tolerance_m:
            self._inside = 0
            return
        self._inside += 1
        if self._inside <= self.settings.dwell_ms:
            return
        self._inside = 0
        self._times.append(tick - self._since)
        self._since = tick
        self._straight_mm += 1e3 * math.dist(self._from[arm], point)
        self._from[arm] = point
        self.target += 1
        self.progress = self.target / len(self.targets)
        if self.target == len(self.targets):
            self._finish(tick, events)

    def restart(self) -> None:
        super().restart()
        self._inside = 0

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        if self.done or self.targets[self.target][0] != arm:
            return None
        return Wish(self.targets[self.target][1])

    def geometry(self) -> dict[str, Any]:
        targets = [
            {
                "number": k,
                "arm": arm,
                "at": rounded(at),
                "radius_m": self._tolerance_m,
                "colour": COLOURS[arm],
            }
            for k, (arm, at) in enumerate(self.targets)
        ]
        return super().geometry() | {"targets": targets}

    def result(self) -> dict[str, Any]:
        return super().result() | {
            "reached": len(self._times),
            "targets": len(self.targets),
            "time_per_target_ms": mean_ms(self._times),
            "straight_mm": round(self._straight_mm, 3),
        }


def _draw(
    settings: Reach, middle: tuple[float, float], rng: np.random.Generator, before: Point
) -> Point:
    """A point of the box that is no repetition of the one before; the farthest of some where the
    box is small.
    """
    extent = settings.extent_mm / 1e3
    points = []
    for _ in range(20):
        x, y = (float(middle[axis] + rng.uniform(-extent, extent)) for axis in (0, 1))
        point = (x, y, surface(x, y) + float(rng.uniform(*settings.height_mm)) / 1e3)
        if math.dist(point, before) > LEAST_WAY_M:
            return point
        points.append(point)
    return max(points, key=lambda point: math.dist(point, before))
