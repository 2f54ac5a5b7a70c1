"""The task of following a closed line. It scores progress and the time near the line."""

import math

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import Json
from ravenjax.train.protocol.world import Point, tissue_height
from ravenjax.train.robot import ArmName
from ravenjax.train.scenario.config import Path
from ravenjax.train.tasks.base import Field, Task, Tips, Wish, round_point

POINTS = 200
"""Points of the line; on the largest line they are half a millimetre apart."""
AHEAD = 8
"""Points that the tip may pass in one tick. A hand passes no more, but a short cut does."""
LOOK_AHEAD_M = 0.003
"""How far ahead on the line a scripted operator aims."""
COLOUR = "#3f7fbf"


class PathTask(Task):
    """One arm follows the line. Two arms take turns, lap by lap."""

    def __init__(self, settings: Path, field: Field) -> None:
        super().__init__("path", field)
        self.settings, self._arms = settings, field.arms
        self.points = [_point(settings, field.middle, k / POINTS) for k in range(POINTS)]
        self.target = 0
        self._tolerance_m = settings.tolerance_mm / 1e3
        # Points passed so far; the next is this one, modulo POINTS.
        self._at = 0
        self._on = False  # whether the tip has come to the line
        self._ticks, self._within = 0, 0
        spacing = math.dist(self.points[0], self.points[1])
        self._look_ahead = max(1, round(LOOK_AHEAD_M / max(spacing, 1e-6)))

    @property
    def _arm(self) -> ArmName:
        return self._arms[(self._at // POINTS) % len(self._arms)]

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        tip = tips[self._arm]
        near, ahead = min(
            (math.dist(tip, self.points[(self._at + k) % POINTS]), k) for k in range(AHEAD)
        )
        if not self._on:
            self._on = near <= self._tolerance_m
            return
        self._ticks += 1
        self._within += near <= self._tolerance_m
        if not ahead or near > self._tolerance_m:  # a tip that left the line resumes where it left
            return
        lap = self._at // POINTS
        self._at += ahead
        if self._at // POINTS > lap and len(self._arms) > 1:
            self._on = False
        self.target = self._at % POINTS
        self.progress = self._at / (POINTS * self.settings.laps)
        if self._at >= POINTS * self.settings.laps:
            self._finish(tick)

    def restart(self) -> None:
        self._on = False

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        if self.done or arm != self._arm:
            return None
        return Wish(self.points[(self._at + (self._look_ahead if self._on else 0)) % POINTS])

    def geometry(self) -> Json:
        path = {
            "points": [round_point(point) for point in (*self.points, self.points[0])],
            "radius_m": self._tolerance_m,
            "colour": COLOUR,
        }
        turns = {"arms": self._arms, "of": self.settings.laps}
        return super().geometry() | {"path": path, "turns": turns}

    def _score(self) -> float:
        return self.progress * (self._within / self._ticks) if self._ticks else 0.0


def _point(settings: Path, middle: tuple[float, float], share: float) -> Point:
    radius, turn = settings.radius_mm / 1e3, 2.0 * math.pi * share
    x = middle[0] + radius * math.cos(turn)
    y = middle[1]
    if settings.shape == "circle":
        y += radius * math.sin(turn)
    elif settings.shape == "eight":
        y += 0.5 * radius * math.sin(2.0 * turn)
    return x, y, tissue_height(x, y) + settings.height_mm / 1e3
