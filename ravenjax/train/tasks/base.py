"""What all tasks have in common: what they tell, and how the tips went meanwhile."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import scene
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.jaws import closing_point
from ravenjax.train.protocol.world import Point, surface, to_world

Event = dict[str, Any]


class Wish(NamedTuple):
    """Where a tip should go next, and what its jaws should do: for scripted operators."""

    point: Point  # m, world
    closed: bool = False


class Task(abc.ABC):
    """A task under way; `step` once a tick."""

    def __init__(self, kind: str, begin: Mapping[ArmName, Point]) -> None:
        self.kind = kind
        self.done = False
        self.target = -1
        """Number of the present goal; -1: none."""
        self.progress = 0.0
        """0 to 1."""
        self._begin = dict(begin)
        self._travels: dict[ArmName, Travel] = {arm: Travel(arm) for arm in begin}
        self._told = -1

    def step(self, frame: Frame, tick: int) -> list[Event]:
        """One tick of the session: events "target", "object" and "task_done"."""
        tips: dict[ArmName, Point] = {
            arm: travel.step(frame) for arm, travel in self._travels.items()
        }
        events: list[Event] = []
        if not self.done:
            self._step(frame, tips, tick, events)
        if self.target != self._told:
            self._told = self.target
            events.append({"tick": tick, "kind": "target", "target": self.target})
        return events

    @abc.abstractmethod
    def _step(
        self, frame: Frame, tips: Mapping[ArmName, Point], tick: int, events: list[Event]
    ) -> None:
        """What is special about the task."""

    def restart(self) -> None:
        """The robot was homed again: what is held is lost, what is done stays done."""
        for travel in self._travels.values():
            travel.lift()

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        """Where the tip (m, world) should go next; None: nowhere."""
        return None

    def geometry(self) -> dict[str, Any]:
        """What the page draws, world coordinates in m; JSON. `turns`: arms that take turns, `of`
        so many in all.
        """
        return {
            "kind": self.kind,
            "targets": [],
            "pegs": [],
            "object": None,
            "path": None,
            "turns": None,
        }

    def result(self) -> dict[str, Any]:
        """Numbers for the debrief: `score` is 0 to 100; lengths in mm, times in ms."""
        return {
            "kind": self.kind,
            "progress": round(self.progress, 4),
            "done": self.done,
            "score": round(100.0 * self._score(), 1),
            "path_mm": {arm: round(travel.path_mm, 3) for arm, travel in self._travels.items()},
            "deepest_mm": {
                arm: _finite(travel.deepest_mm) for arm, travel in self._travels.items()
            },
        }

    def _score(self) -> float:
        """0 to 1."""
        return self.progress

    def _finish(self, tick: int, events: list[Event]) -> None:
        self.done, self.target, self.progress = True, -1, 1.0
        events.append({"tick": tick, "kind": "task_done"})


class FreeTask(Task):
    """Nothing is asked: look around, feel the robot. No goal, never done."""

    def __init__(self, begin: Mapping[ArmName, Point]) -> None:
        super().__init__("free", begin)

    def _step(
        self, frame: Frame, tips: Mapping[ArmName, Point], tick: int, events: list[Event]
    ) -> None:
        """Nothing to do."""


class Travel:
    """The way of one tip: of the point where the jaws close."""

    __slots__ = ("_last", "_places", "arm", "deepest_mm", "path_mm")

    def __init__(self, arm: ArmName) -> None:
        self.arm: ArmName = arm
        self.path_mm = 0.0
        self.deepest_mm = -math.inf
        self._places: tuple[int, int] | None = (
            None  # of the jaws' axis and of the joints in a frame
        )
        self._last: Point | None = None

    def step(self, frame: Frame) -> Point:
        """The tip in the world, m."""
        if self._places is None:
            places = frame.layout.places
            self._places = places[f"{self.arm}/tip"].start, places[f"{self.arm}/link_jpos"].start
        axis, joints = self._places
        numbers = frame.numbers
        tip = to_world(
            self.arm,
            closing_point(self.arm, numbers[axis : axis + 3], numbers[joints : joints + 7]),
        )
        if self._last is not None:
            self.path_mm += 1e3 * math.dist(tip, self._last)
        self._last = tip
        self.deepest_mm = max(self.deepest_mm, _depth_mm(tip))
        return tip

    def lift(self) -> None:
        """The tip is put elsewhere: that is no way of its own."""
        self._last = None


def _depth_mm(tip: Point) -> float:
    """How far a tip is below the tissue's surface; -inf beside it."""
    x, y, z = tip
    beside = abs(x) > scene.TISSUE_HALF[0] or abs(y) > scene.TISSUE_HALF[1]
    return -math.inf if beside else 1e3 * (surface(x, y) - z)


def _finite(depth_mm: float) -> float | None:
    """None where the tip was never above the tissue."""
    return round(depth_mm, 3) if math.isfinite(depth_mm) else None


def rounded(point: Point) -> list[float]:
    """A point for the page, to a micrometre."""
    return [round(x, 6) for x in point]
