"""Defines the operator's tasks: reach targets (also in levels), transfer an object, follow a line.

All positions are in world coordinates, m. The middle of a task lies between the start positions of
the tips. Tasks do not affect the robot: targets, pegs and objects exert no force.
"""

import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.train.protocol import (
    Event,
    Frame,
    Json,
    Point,
    closing_point,
    tissue_height,
    to_world,
)
from ravenjax.train.robot import ArmName, Arms
from ravenjax.train.scenario import Scenario
from ravenjax.train.scenario.config import Levels, Path, PegTransfer, Reach

Tips = Mapping[ArmName, Point]
"""The point where the jaws of each arm close, m, world."""
POINTS = 200
"""Number of points of a line. On the largest line they are half a millimetre apart."""
AHEAD = 8
"""The largest number of points that count as passed in one tick. A short cut passes more."""
LOOK_AHEAD_M = 0.003
"""Distance ahead on the line to which a simulated operator moves."""
PATH_COLOUR = "#3f7fbf"
CLOSED_RAD, OPEN_RAD = 0.8, 1.1
"""Jaws hold an object below the first opening and release it above the second. The opening is 1.57
at home. The generated motion of a peg transfer closes the jaws to 0.67.
"""
LIFT_M = 0.008
"""Height above pegs at which a simulated operator moves the object."""
PEG_RADIUS_M, OBJECT_RADIUS_M = 0.001, 0.002
PEG_COLOURS = {"peg": "#8a8f98", "object": "#c8553d"}
LEAST_WAY_M = 0.005
"""The least distance between two successive targets."""
TARGET_COLOURS = {"gold": "#d9a441", "green": "#1fae84"}


class Field(NamedTuple):
    """The arms and the position of a task, and the seed of its goals."""

    arms: Arms  # arms that do the task, in turn
    begin: Tips  # start positions of the tips
    middle: tuple[float, float]  # x and y between the start positions, m
    seed: int


class Wish(NamedTuple):
    """The next aim of a simulated operator: a position of the tip, and whether the jaws close."""

    point: Point  # m, world
    closed: bool = False


class Task:
    """A task; call `step` once a tick. This base class has no goals and is never done."""

    def __init__(self, settings: Any, field: Field) -> None:
        """settings: the scenario's [task]."""
        self.settings, self._field, self._arms = settings, field, field.arms
        self.done = False
        self.target = -1
        """Number of the present goal; -1: none."""
        self.progress = 0.0
        """0 to 1."""
        self._published = -1
        self._events: list[Event] = []

    def step(self, frame: Frame, tick: int) -> list[Event]:
        """Process one tick. Return its events: "target", "object", "level" and "task_done"."""
        self._events = []
        if not self.done:
            tips: dict[ArmName, Point] = {}
            for arm in self._field.begin:
                axis, joints = (frame[f"{arm}/{name}"].tolist() for name in ("tip", "link_jpos"))
                tips[arm] = to_world(arm, closing_point(arm, axis, joints))
            self._step(frame, tips, tick)
        if self.target != self._published:
            self._published = self.target
            self._record(tick, "target", target=self.target)
        return self._events

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        """Process one tick of this kind of task."""

    def restart(self) -> None:
        """Adapt to a robot that was homed again: a held object is lost, and progress stays."""

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        """Return the next aim of a simulated operator, or None. tip: m, world."""
        return None if self.done or arm != self._arm else self._wish(tip)

    @property
    def _arm(self) -> ArmName | None:
        """The arm whose turn it is."""

    def _wish(self, tip: Point) -> Wish | None:
        """Return the aim of the arm whose turn it is."""

    def geometry(self) -> Json:
        """Return the shapes for the page as JSON, m, world. `turns`: arms, number of turns."""
        empty = dict.fromkeys(("object", "path", "turns"))
        return {"kind": self.settings.kind, "targets": [], "pegs": []} | empty | self._shapes()

    def _shapes(self) -> Json:
        """Return the entries of `geometry` of this kind of task."""
        return {}

    def result(self) -> Json:
        """Return numbers for the debrief: `progress` is 0 to 1, `score` 0 to 100."""
        return {
            "kind": self.settings.kind,
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


def _spot(number: int, at: Point, radius_m: float, colour: str) -> Json:
    return {"number": number, "at": round_point(at), "radius_m": radius_m, "colour": colour}


class PathTask(Task):
    """The tip follows a line. Two arms take turns, lap by lap."""

    def __init__(self, settings: Path, field: Field) -> None:
        super().__init__(settings, field)
        self.points = [_point(settings, field.middle, k / POINTS) for k in range(POINTS)]
        self.target = 0
        self._tolerance_m = settings.tolerance_mm / 1e3
        # Number of passed points. Modulo POINTS, it is the index of the next point.
        self._at = 0
        self._on = False  # whether the tip has reached the line
        self._ticks, self._within = 0, 0
        spacing = math.dist(self.points[0], self.points[1])
        self._look_ahead = max(1, round(LOOK_AHEAD_M / max(spacing, 1e-6)))

    @property
    def _arm(self) -> ArmName:
        return self._arms[(self._at // POINTS) % len(self._arms)]

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        # Follows the line. Progress counts only while the tip is within the tolerance.
        tip = tips[self._arm]
        near, ahead = min(
            (math.dist(tip, self.points[(self._at + k) % POINTS]), k) for k in range(AHEAD)
        )
        if not self._on:
            self._on = near <= self._tolerance_m
            return
        self._ticks += 1
        self._within += near <= self._tolerance_m
        if not ahead or near > self._tolerance_m:  # progress continues where the tip left the line
            return
        lap = self._at // POINTS
        self._at += ahead
        # The next lap is for the other arm, which must first reach the line.
        if self._at // POINTS > lap and len(self._arms) > 1:
            self._on = False
        self.target = self._at % POINTS
        self.progress = self._at / (POINTS * self.settings.laps)
        if self._at >= POINTS * self.settings.laps:
            self._finish(tick)

    def restart(self) -> None:
        self._on = False

    def _wish(self, tip: Point) -> Wish:
        return Wish(self.points[(self._at + (self._look_ahead if self._on else 0)) % POINTS])

    def _shapes(self) -> Json:
        path = {
            "points": [round_point(point) for point in (*self.points, self.points[0])],
            "radius_m": self._tolerance_m,
            "colour": PATH_COLOUR,
        }
        return {"path": path, "turns": {"arms": self._arms, "of": self.settings.laps}}

    def _score(self) -> float:
        return self.progress * (self._within / self._ticks) if self._ticks else 0.0


def _point(settings: Path, middle: tuple[float, float], share: float) -> Point:
    radius, turn = settings.radius_mm / 1e3, 2.0 * math.pi * share
    aside = {"circle": math.sin(turn), "eight": 0.5 * math.sin(2.0 * turn), "line": 0.0}
    x, y = middle[0] + radius * math.cos(turn), middle[1] + radius * aside[settings.shape]
    return x, y, tissue_height(x, y) + settings.height_mm / 1e3


class PegTask(Task):
    """The operator transfers one object from peg to peg; two arms take turns.

    Jaws that close within `tolerance_mm` of the object hold it until they open. If they open near
    the peg that is the goal, the object is placed. Otherwise it drops to the tissue, and the
    operator must fetch it.
    """

    def __init__(self, settings: PegTransfer, field: Field) -> None:
        super().__init__(settings, field)
        spacing, per_row = settings.spacing_mm / 1e3, settings.pegs // 2
        self.pegs: list[Point] = []
        for row, k in itertools.product(range(2), range(per_row)):
            x = field.middle[0] + spacing * (k - (per_row - 1) / 2.0)
            y = field.middle[1] + spacing * (row - 0.5)
            self.pegs.append((x, y, tissue_height(x, y) + settings.height_mm / 1e3))
        rng = np.random.default_rng([field.seed, settings.seed, 2])
        self.ways = [int(rng.integers(settings.pegs))]
        """The pegs on which the object is to be, in order."""
        for _ in range(settings.transfers):
            others = [peg for peg in range(settings.pegs) if peg != self.ways[-1]]
            self.ways.append(int(rng.choice(others)))
        self.object: Point = self.pegs[self.ways[0]]
        self.held: ArmName | None = None
        self.placed, self.dropped = 0, 0
        self.target = len(self.pegs)
        self._tolerance_m = settings.tolerance_mm / 1e3
        self._closed = dict.fromkeys(self._arms, False)

    @property
    def _arm(self) -> ArmName:
        return self._arms[self.placed % len(self._arms)]

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        # Jaws that close near the object hold it. Jaws that open release it.
        for arm, closed in self._closed.items():
            opening = float(frame[f"{arm}/link_jpos"][5:7].sum(dtype=float))
            closes, opens = not closed and opening < CLOSED_RAD, closed and opening > OPEN_RAD
            if closes or opens:
                self._closed[arm] = closes
            if arm == self.held:
                self.object = tips[arm]
                if opens:
                    self._release(tick)
            elif (
                closes
                and self.held is None
                and math.dist(tips[arm], self.object) <= self._tolerance_m
            ):
                self.held = arm
                self.target = self.ways[self.placed + 1]
                self._record_object(tick)

    def _release(self, tick: int) -> None:
        # Places an object that is within the tolerance of its peg, and drops another object.
        x, y, z = self.object
        self.held, peg = None, self.pegs[self.ways[self.placed + 1]]
        self.target = len(self.pegs)
        if math.dist(self.object, peg) <= self._tolerance_m:
            self.object = peg
            self.placed += 1
            self.progress = self.placed / self.settings.transfers
        else:
            self.object = (x, y, min(z, tissue_height(x, y) + OBJECT_RADIUS_M))
            self.dropped += 1
        self._record_object(tick)
        if self.placed == self.settings.transfers:
            self._finish(tick)

    def _record_object(self, tick: int) -> None:
        self._record(tick, "object", held=self.held or "", at=round_point(self.object))

    def restart(self) -> None:
        """Put a held object back on its peg, because the robot that held it has moved away."""
        if self.held is not None:
            self.held, self.object = None, self.pegs[self.ways[self.placed]]
            self.target = len(self.pegs)
        self._closed = dict.fromkeys(self._arms, False)

    def _wish(self, tip: Point) -> Wish:
        holding = self.held == self._arm
        x, y, z = self.pegs[self.target] if holding else self.object
        aside = math.hypot(tip[0] - x, tip[1] - y)
        there = aside < 0.5 * self._tolerance_m and abs(tip[2] - z) < 0.5 * self._tolerance_m
        if holding and tip[2] < z + LIFT_M - 0.002 and aside > self._tolerance_m:
            return Wish((tip[0], tip[1], z + LIFT_M), True)  # lift the object first
        over = z if aside < 0.5 * self._tolerance_m else z + LIFT_M
        return Wish((x, y, over), holding != there)

    def _shapes(self) -> Json:
        height = {"height_m": self.settings.height_mm / 1e3}
        pegs = [
            _spot(k, top, PEG_RADIUS_M, PEG_COLOURS["peg"]) | height
            for k, top in enumerate(self.pegs)
        ]
        thing = _spot(len(self.pegs), self.object, OBJECT_RADIUS_M, PEG_COLOURS["object"])
        turns = {"arms": self._arms, "of": self.settings.transfers}
        return {"pegs": pegs, "object": thing, "turns": turns}

    def _score(self) -> float:
        """Return the share of transfers done. A drop costs half a transfer."""
        return max(0.0, self.placed - 0.5 * self.dropped) / self.settings.transfers


class ReachTask(Task):
    """The tip reaches targets in a box above the tissue. Two arms take turns."""

    def __init__(self, settings: Reach, field: Field) -> None:
        super().__init__(settings, field)
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
        # A target is reached when the tip has stayed within the tolerance for `dwell_ms`.
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

    @property
    def _arm(self) -> ArmName:
        return self.targets[self.target][0]

    def _wish(self, tip: Point) -> Wish:
        return Wish(self.targets[self.target][1])

    def _shapes(self) -> Json:
        radius = self.settings.tolerance_mm / 1e3
        targets = [
            _spot(k, at, radius, TARGET_COLOURS[arm]) | {"arm": arm}
            for k, (arm, at) in enumerate(self.targets)
        ]
        return {"targets": targets}


class LevelsTask(Task):
    """Levels of rounds of targets. A level ends after some rounds in a row within the time.

    All rounds of a level have the same targets. The time of a round runs from its first target to
    its last, so that the operator can rest between rounds. Surgical skills are taught in this way
    (Ritter, Scott, Surg. Innov. 14, 2007). Numbers of targets continue through all levels.
    """

    def __init__(self, settings: Levels, field: Field) -> None:
        super().__init__(settings, field)
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
        # The events of the round's own task are ignored.
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
        # Ends a round, and the level after enough rounds in a row within the time.
        level, levels = self._level, len(self.settings.level)
        took = tick - (self._begun or 0)
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

    def _shapes(self) -> Json:
        targets = [
            target | {"number": first + target["number"]}
            for level, first in enumerate(self._first)
            for target in self._round(level).geometry()["targets"]
        ]
        return {"targets": targets}

    def result(self) -> Json:
        return super().result() | {
            "levels": len(self.settings.level),
            "levels_proficient": self._level,
            "rounds_s_of_level": [[ms / 1000.0 for ms in rounds] for rounds in self._rounds_ms],
        }


def _draw(
    settings: Reach, middle: tuple[float, float], rng: np.random.Generator, before: Point
) -> Point:
    """Return a random point that is not too near to `before`; in a small box the farthest of 20."""
    extent = settings.extent_mm / 1e3
    points = []
    for _ in range(20):
        x, y = (float(middle[axis] + rng.uniform(-extent, extent)) for axis in (0, 1))
        point = (x, y, tissue_height(x, y) + float(rng.uniform(*settings.height_mm)) / 1e3)
        if math.dist(point, before) > LEAST_WAY_M:
            return point
        points.append(point)
    return max(points, key=lambda point: math.dist(point, before))


def make_task(scenario: Scenario, tips: Mapping[ArmName, Point], seed: int) -> Task:
    """Return the task of a session. tips: start positions, m, in frame 0 of each arm."""
    settings = scenario.task
    arms = settings.arms or scenario.arms
    begin: dict[ArmName, Point] = {arm: to_world(arm, tips[arm]) for arm in scenario.arms}
    x, y = (sum(begin[arm][axis] for arm in arms) / len(arms) for axis in (0, 1))
    field = Field(tuple(arms), begin, (x, y), seed)
    kinds = {"reach": ReachTask, "peg_transfer": PegTask, "path": PathTask, "levels": LevelsTask}
    return kinds.get(settings.kind, Task)(settings, field)
