"""Common parts of all tasks: goals, progress and events."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import Event, Json
from ravenjax.train.protocol.world import Point, closing_point, to_world
from ravenjax.train.robot import ArmName, Arms

Tips = Mapping[ArmName, Point]
"""Where the jaws of each arm close, m, world."""


class Field(NamedTuple):
    """The place of a task, and the seed of its goals."""

    arms: Arms  # arms that do the task, in turn
    begin: Tips  # where the tips begin
    middle: tuple[float, float]  # of the tips, m
    seed: int


class Wish(NamedTuple):
    """The next aim of a scripted operator: where a tip should go, and what its jaws should do."""

    point: Point  # m, world
    closed: bool = False


class Task:
    """A task under way; call `step` once a tick. This base class has no goals and is never done."""

    def __init__(self, kind: str, field: Field) -> None:
        self.kind, self._field = kind, field
        self.done = False
        self.target = -1
        """Number of the present goal; -1: none."""
        self.progress = 0.0
        """0 to 1."""
        self._published = -1
        self._events: list[Event] = []

    def step(self, frame: Frame, tick: int) -> list[Event]:
        """Advance by one tick. Return the events "target", "object", "level" and "task_done"."""
        self._events = []
        if not self.done:
            places, numbers = frame.layout.places, frame.numbers
            tips: dict[ArmName, Point] = {}
            for arm in self._field.begin:
                axis, joints = places[f"{arm}/tip"], places[f"{arm}/link_jpos"]
                tips[arm] = to_world(arm, closing_point(arm, numbers[axis], numbers[joints]))
            self._step(frame, tips, tick)
        if self.target != self._published:
            self._published = self.target
            self._record(tick, "target", target=self.target)
        return self._events

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        """Advance what is specific to the kind of task."""

    def restart(self) -> None:
        """Adapt to a robot that was homed again: what is held is lost, what is done stays done."""

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        """Return where the tip (m, world) should go next, or None."""
        return None

    def geometry(self) -> Json:
        """Return JSON of what the page draws, m, world. `turns`: the arms, and how many turns."""
        empty = dict.fromkeys(("object", "path", "turns"))
        return {"kind": self.kind, "targets": [], "pegs": []} | empty

    def result(self) -> Json:
        """Return numbers for the debrief: `progress` is 0 to 1, `score` 0 to 100."""
        return {
            "kind": self.kind,
            "progress": round(self.progress, 4),
            "done": self.done,
            "score": round(100.0 * self._score(), 1),
        }

    def _score(self) -> float:
        return self.progress

    def _finish(self, tick: int) -> None:
        self.done, self.target, self.progress = True, -1, 1.0
        self._record(tick, "task_done")

    def _record(self, tick: int, kind: str, **what: Any) -> None:
        self._events.append({"tick": tick, "kind": kind, **what})


def round_point(point: Point) -> list[float]:
    """Return a point for the page, rounded to a micrometre."""
    return [round(x, 6) for x in point]
