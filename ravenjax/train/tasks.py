"""Defines the tasks: reach targets (once, or in levels), transfer an object, or follow a line.

All positions are in world coordinates, m. The middle of a task lies between the start positions of
the tips. Tasks do not affect the robot: targets, pegs and objects exert no force.
"""

import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.train import protocol
from ravenjax.train.protocol import Event, Frame, Json, Point, tissue_height
from ravenjax.train.robot import ArmName, Arms
from ravenjax.train.scenario import Scenario
from ravenjax.train.scenario.config import Levels, Path, PegTransfer, Reach

Tips = Mapping[ArmName, Point]  # The point where the jaws of each arm close, m, world
POINTS = 200  # Number of points of a line. On the largest line they are half a millimetre apart.
MAX_POINTS_PER_TICK = 8
"""The largest number of points that count as passed in one tick. A short cut passes more."""
LOOK_AHEAD_M = 0.003  # Distance ahead on the line to which a simulated operator moves
PATH_COLOUR = "#3f7fbf"
CLOSED_RAD, OPEN_RAD = 0.8, 1.1
"""Jaws hold an object below the first opening and release it above the second. The opening is 1.57
at home. The generated motion of a peg transfer closes the jaws to 0.67.
"""
LIFT_M = 0.008  # Height above pegs at which a simulated operator moves the object
PEG_RADIUS_M, OBJECT_RADIUS_M = 0.001, 0.002
PEG_COLOUR, OBJECT_COLOUR = "#8a8f98", "#c8553d"
MIN_DISTANCE_M = 0.005  # The smallest distance between two successive targets
TARGET_COLOURS = {"gold": "#d9a441", "green": "#1fae84"}


class Workspace(NamedTuple):
    """The arms and the position of a task, and the seed of its goals."""

    arms: Arms  # arms that do the task, in turn
    start_tips: Tips  # start positions of the tips
    middle: tuple[float, float]  # x and y between the start positions, m
    seed: int


class Aim(NamedTuple):
    """The next aim of a simulated operator: a position of the tip, and whether the jaws close."""

    point: Point  # m, world
    jaws_closed: bool = False


class Task:
    """A task; call `step` once a tick. This base class has no goals and is never done."""

    done = False
    target = -1
    """Number of the present goal; -1: none."""
    progress = 0.0  # 0 to 1
    _published_target = -1  # in the last event

    def __init__(self, settings: Any, workspace: Workspace):
        """settings: the scenario's [task]."""
        self.settings, self._workspace, self._arms = settings, workspace, workspace.arms
        self._events: list[Event] = []

    def step(self, frame: Frame, tick: int) -> list[Event]:
        """Process one tick. Return its events, of kind target, object, level or task_done."""
        self._events = []
        if not self.done:
            # `start_tips` has all arms of the session, also those that do not do the task.
            session_arms = self._workspace.start_tips
            tips: Tips = {arm: protocol.tip_in_world(frame, arm) for arm in session_arms}
            self._step(frame, tips, tick)
        if self.target != self._published_target:
            self._published_target = self.target
            self._record("target", target=self.target)
        return self._events

    def _step(self, frame: Frame, tips: Tips, tick: int):
        """Process one tick of this kind of task."""

    def restart(self) -> None:
        """Adapt to a robot that was homed again: a held object is lost, and progress stays."""

    def next_aim(self, arm: ArmName, tip: Point) -> Aim | None:
        """Return where a simulated operator moves this arm next, from `tip`, m, world. None if
        another arm's turn is on, or if nothing is left to do.
        """
        return None if self.done or arm != self._arm else self._next_aim(tip)

    @property
    def _arm(self) -> ArmName | None:
        """The arm whose turn it is."""

    def _next_aim(self, tip: Point) -> Aim | None:
        """Return the aim of the arm whose turn it is."""

    def geometry(self) -> Json:
        """Return the shapes that the page draws as JSON: targets, pegs, object, path; m, world.
        "turns" has the arms that take turns and the number of turns ("of").
        """
        empty = dict.fromkeys(("object", "path", "turns"))
        return {"kind": self.settings.kind, "targets": [], "pegs": []} | empty | self._shapes()

    def _shapes(self) -> Json:
        """Return the entries of `geometry` of this kind of task."""
        return {}

    def result(self) -> Json:
        """Return the result for the debrief: kind, progress (0 to 1), done, score (0 to 100)."""
        return {
            "kind": self.settings.kind,
            "progress": round(self.progress, 4),
            "done": self.done,
            "score": round(100.0 * self._score(), 1),
        }

    def _score(self) -> float:
        # Returns the score, 0 to 1.
        return self.progress

    def _advance(self, share: float):
        """Set the progress. A share of 1 ends the task."""
        self.progress = min(share, 1.0)
        if share >= 1.0:
            self.done, self.target = True, -1
            self._record("task_done")

    def _record(self, kind: str, **content):
        self._events.append({"kind": kind, **content})


def round_point(point: Point) -> list[float]:
    """Return a point for the page, rounded to a micrometre."""
    return [round(x, 6) for x in point]


def _spot(number: int, position: Point, radius_m: float, colour: str) -> Json:
    return {"number": number, "at": round_point(position), "radius_m": radius_m, "colour": colour}


class PathTask(Task):
    """The tip follows a line. Two arms take turns, lap by lap."""

    target = 0
    # Number of passed points in all laps. Modulo POINTS, it is the index of the next point.
    _passed_points = 0
    _is_on_line = False  # whether the tip has reached the line
    _ticks, _ticks_within = 0, 0  # Since then: ticks, and ticks within the tolerance

    def __init__(self, settings: Path, workspace: Workspace):
        super().__init__(settings, workspace)
        self.points = [_point(settings, workspace.middle, k / POINTS) for k in range(POINTS)]
        self._tolerance_m = settings.tolerance_mm / 1e3
        spacing = math.dist(self.points[0], self.points[1])
        self._look_ahead = max(1, round(LOOK_AHEAD_M / max(spacing, 1e-6)))

    @property
    def _arm(self) -> ArmName:
        return self._arms[(self._passed_points // POINTS) % len(self._arms)]

    def _step(self, frame: Frame, tips: Tips, tick: int):
        # Measures the progress along the line, which counts only within the tolerance.
        tip, first = tips[self._arm], self._passed_points
        # The nearest of the next points, and how many points ahead it is. Points farther ahead are
        # not considered, so that a short cut is no progress.
        distance, points_ahead = min(
            (math.dist(tip, self.points[(first + k) % POINTS]), k)
            for k in range(MAX_POINTS_PER_TICK)
        )
        is_within = distance <= self._tolerance_m
        if not self._is_on_line:
            self._is_on_line = is_within
            return
        self._ticks += 1
        self._ticks_within += is_within
        # A tip that left the line makes progress again where it left the line.
        if points_ahead == 0 or not is_within:
            return
        self._passed_points += points_ahead
        # The next lap is for the other arm, which must first reach the line.
        is_new_lap = self._passed_points // POINTS > first // POINTS
        if is_new_lap and len(self._arms) > 1:
            self._is_on_line = False
        self.target = self._passed_points % POINTS
        self._advance(self._passed_points / (POINTS * self.settings.laps))

    def restart(self) -> None:
        self._is_on_line = False

    def _next_aim(self, tip: Point) -> Aim:
        points_ahead = self._look_ahead if self._is_on_line else 0
        return Aim(self.points[(self._passed_points + points_ahead) % POINTS])

    def _shapes(self) -> Json:
        path = {
            "points": [round_point(point) for point in (*self.points, self.points[0])],
            "radius_m": self._tolerance_m,
            "colour": PATH_COLOUR,
        }
        return {"path": path, "turns": {"arms": self._arms, "of": self.settings.laps}}

    def _score(self) -> float:
        return self.progress * (self._ticks_within / self._ticks) if self._ticks else 0.0


def _point(settings: Path, middle: tuple[float, float], share: float) -> Point:
    """Return the point after this share (0 to 1) of the line around `middle`, m, world."""
    radius, angle = settings.radius_mm / 1e3, 2.0 * math.pi * share
    relative_y = {"circle": math.sin(angle), "eight": 0.5 * math.sin(2.0 * angle), "line": 0.0}
    x, y = middle[0] + radius * math.cos(angle), middle[1] + radius * relative_y[settings.shape]
    return x, y, tissue_height(x, y) + settings.height_mm / 1e3


class PegTask(Task):
    """The operator transfers one object from peg to peg; two arms take turns. Jaws that close
    within `tolerance_mm` of the object hold it until they open. If they open near the peg that is
    the goal, the object is placed. Otherwise it drops to the tissue, where it must be fetched.
    """

    held: ArmName | None = None  # The arm that holds the object
    placed, dropped = 0, 0

    def __init__(self, settings: PegTransfer, workspace: Workspace):
        super().__init__(settings, workspace)
        spacing, per_row = settings.spacing_mm / 1e3, settings.pegs // 2
        # Tops of the pegs, in two rows that are centred on the middle.
        self.pegs: list[Point] = []
        for row, k in itertools.product(range(2), range(per_row)):
            x = workspace.middle[0] + spacing * (k - (per_row - 1) / 2.0)
            y = workspace.middle[1] + spacing * (row - 0.5)
            self.pegs.append((x, y, tissue_height(x, y) + settings.height_mm / 1e3))
        # The 2 separates these draws from those of another task with the same seeds.
        rng = np.random.default_rng([workspace.seed, settings.seed, 2])
        self.route = [int(rng.integers(settings.pegs))]
        """Numbers of the pegs on which the object is to be, in order. The first is the start."""
        for _ in range(settings.transfers):
            others = [peg for peg in range(settings.pegs) if peg != self.route[-1]]
            self.route.append(int(rng.choice(others)))
        self.object: Point = self.pegs[self.route[0]]
        # The goal is a peg, or the object, whose number follows those of the pegs.
        self.target = self._object_number = len(self.pegs)
        self._tolerance_m = settings.tolerance_mm / 1e3
        self._closed = dict.fromkeys(self._arms, False)

    @property
    def _arm(self) -> ArmName:
        return self._arms[self.placed % len(self._arms)]

    def _step(self, frame: Frame, tips: Tips, tick: int):
        # Jaws that close near the object hold it. Jaws that open release it.
        for arm, was_closed in self._closed.items():
            # The opening is the sum of the angles of both jaws, which are joints 5 and 6.
            opening = float(frame[f"{arm}/link_jpos"][5:7].sum(dtype=float))
            closes = not was_closed and opening < CLOSED_RAD
            opens = was_closed and opening > OPEN_RAD
            if closes or opens:
                self._closed[arm] = closes
            is_near = math.dist(tips[arm], self.object) <= self._tolerance_m
            if arm == self.held:
                self.object = tips[arm]
                if opens:
                    self._release()
            elif closes and is_near and self.held is None:
                self.held = arm
                self.target = self.route[self.placed + 1]
                self._record_object()

    def _release(self):
        # Places the object if it is within the tolerance of its peg. Otherwise it drops.
        x, y, z = self.object
        self.held, peg = None, self.pegs[self.route[self.placed + 1]]
        self.target = self._object_number
        if math.dist(self.object, peg) <= self._tolerance_m:
            self.object = peg
            self.placed += 1
        else:
            self.object = (x, y, min(z, tissue_height(x, y) + OBJECT_RADIUS_M))
            self.dropped += 1
        self._record_object()
        self._advance(self.placed / self.settings.transfers)

    def _record_object(self):
        self._record("object", held=self.held or "", at=round_point(self.object))

    def restart(self) -> None:
        """Put a held object back on its peg, because the robot that held it has moved away."""
        if self.held is not None:
            self.held, self.object = None, self.pegs[self.route[self.placed]]
            self.target = self._object_number
        self._closed = dict.fromkeys(self._arms, False)

    def _next_aim(self, tip: Point) -> Aim:
        # Above the object or peg, the tip moves sideways. It goes down when it is near enough.
        holding = self.held == self._arm
        x, y, z = self.pegs[self.target] if holding else self.object
        distance_xy = math.hypot(tip[0] - x, tip[1] - y)
        is_above = distance_xy < 0.5 * self._tolerance_m
        is_at_goal = is_above and abs(tip[2] - z) < 0.5 * self._tolerance_m
        # A held object is lifted first, so that it passes over the pegs. 2 mm below is high enough.
        if holding and tip[2] < z + LIFT_M - 0.002 and distance_xy > self._tolerance_m:
            return Aim((tip[0], tip[1], z + LIFT_M), jaws_closed=True)
        # The jaws change only at the goal: they open if they hold the object, else they close.
        return Aim((x, y, z if is_above else z + LIFT_M), jaws_closed=holding != is_at_goal)

    def _shapes(self) -> Json:
        height = {"height_m": self.settings.height_mm / 1e3}
        pegs = [_spot(k, top, PEG_RADIUS_M, PEG_COLOUR) | height for k, top in enumerate(self.pegs)]
        shape = _spot(self._object_number, self.object, OBJECT_RADIUS_M, OBJECT_COLOUR)
        turns = {"arms": self._arms, "of": self.settings.transfers}
        return {"pegs": pegs, "object": shape, "turns": turns}

    def _score(self) -> float:
        """Return the share of transfers done. A drop costs half a transfer."""
        return max(0.0, self.placed - 0.5 * self.dropped) / self.settings.transfers


class ReachTask(Task):
    """The tip reaches targets in a box above the tissue. Two arms take turns."""

    target = 0
    _inside_ms = 0

    def __init__(self, settings: Reach, workspace: Workspace):
        super().__init__(settings, workspace)
        # The 1 separates these draws from those of another task with the same seeds.
        rng = np.random.default_rng([workspace.seed, settings.seed, 1])
        self.targets: list[tuple[ArmName, Point]] = []
        # Each arm's last target; at first, its start position.
        last_points = dict(workspace.start_tips)
        for k in range(settings.targets):
            arm = workspace.arms[k % len(workspace.arms)]
            last_points[arm] = self._draw_point(rng, last_points[arm])
            self.targets.append((arm, last_points[arm]))

    def _draw_point(self, rng: np.random.Generator, last_point: Point) -> Point:
        """Return the first random point that is farther than `MIN_DISTANCE_M` from `last_point`. In
        a small box there may be none; the farthest of 20 points is returned then.
        """
        extent = self.settings.extent_mm / 1e3
        points = []
        for _ in range(20):
            middle = self._workspace.middle
            x, y = (float(centre + rng.uniform(-extent, extent)) for centre in middle)
            height = float(rng.uniform(*self.settings.height_mm)) / 1e3
            points.append((x, y, tissue_height(x, y) + height))
            if math.dist(points[-1], last_point) > MIN_DISTANCE_M:
                return points[-1]
        return max(points, key=lambda point: math.dist(point, last_point))

    def _step(self, frame: Frame, tips: Tips, tick: int):
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
        self._advance(self.target / len(self.targets))

    def restart(self) -> None:
        self._inside_ms = 0

    @property
    def _arm(self) -> ArmName:
        return self.targets[self.target][0]

    def _next_aim(self, tip: Point) -> Aim:
        return Aim(self.targets[self.target][1])

    def _shapes(self) -> Json:
        radius = self.settings.tolerance_mm / 1e3
        targets = [
            _spot(k, position, radius, TARGET_COLOURS[arm]) | {"arm": arm}
            for k, (arm, position) in enumerate(self.targets)
        ]
        return {"targets": targets}


class LevelsTask(Task):
    """Levels of rounds of targets. A level ends after some rounds in a row within the time. All
    rounds of a level have the same targets. The time of a round runs from its first target to its
    last, so that the operator can rest between rounds. Surgical skills are taught in this way
    (Ritter, Scott, Surg. Innov. 14, 2007). Numbers of targets continue through all levels.
    """

    _level = 0
    _rounds_in_a_row = 0
    # Tick at which the round's first target was reached.
    _round_start: int | None = None
    target = 0

    def __init__(self, settings: Levels, workspace: Workspace):
        super().__init__(settings, workspace)
        counts = [level.targets for level in settings.level[:-1]]
        self._first_targets = [0, *itertools.accumulate(counts)]
        # Durations of the rounds of each level.
        self._rounds_ms: list[list[int]] = [[] for _ in settings.level]
        self._round = self._make_round(0)

    def _step(self, frame: Frame, tips: Tips, tick: int):
        # Records the first level in the first tick. `_end_round` records the others.
        if self._published_target < 0:
            self._record_level()
        # A level has several rounds. A round is a task of its own, whose events are ignored.
        self._round._step(frame, tips, tick)
        if self._round_start is None and self._round.target != 0:
            self._round_start = tick
        if self._round.done:
            self._end_round(tick)
        if not self.done:
            self.target = self._first_targets[self._level] + self._round.target

    def _make_round(self, number: int) -> ReachTask:
        level, workspace = self.settings.level[number], self._workspace
        arms = tuple(level.arms or workspace.arms)
        return ReachTask(level, workspace._replace(arms=arms, seed=workspace.seed + number))

    def _end_round(self, tick: int):
        # Ends a round, and the level after enough rounds in a row within the time.
        level, rounds_needed = self._level, self.settings.in_a_row
        duration_ms = tick - (self._round_start or 0)
        in_time = duration_ms <= 1000.0 * self.settings.level[level].within_s
        self._rounds_ms[level].append(duration_ms)
        self._rounds_in_a_row = self._rounds_in_a_row + 1 if in_time else 0
        self._round_start = None
        if self._rounds_in_a_row == rounds_needed:
            self._level, self._rounds_in_a_row = level + 1, 0
        levels_done = self._level + self._rounds_in_a_row / rounds_needed
        self._advance(levels_done / len(self.settings.level))
        if not self.done:
            self._round = self._make_round(self._level)
            self._record_level(duration_ms, in_time)

    def _record_level(self, took_ms: int | None = None, in_time: bool = False):
        # Records the level and the last round; took_ms None: there was no round before.
        level = self.settings.level[self._level]
        self._record(
            "level",
            level=self._level + 1,
            of=len(self.settings.level),
            title=level.title,
            within_s=level.within_s,
            in_a_row=self._rounds_in_a_row,
            needs=self.settings.in_a_row,
            took_ms=took_ms,
            within=in_time,
        )

    def restart(self) -> None:
        self._round.restart()

    def next_aim(self, arm: ArmName, tip: Point) -> Aim | None:
        return None if self.done else self._round.next_aim(arm, tip)

    def _shapes(self) -> Json:
        targets = []
        for level, first in enumerate(self._first_targets):
            for target in self._make_round(level).geometry()["targets"]:
                targets.append(target | {"number": first + target["number"]})
        return {"targets": targets}

    def result(self) -> Json:
        return super().result() | {
            "levels": len(self.settings.level),
            "levels_proficient": self._level,
            "rounds_s_of_level": [[ms / 1000.0 for ms in rounds] for rounds in self._rounds_ms],
        }


def make_task(scenario: Scenario, tips: Mapping[ArmName, Point], seed: int) -> Task:
    """Return the task of a session. tips: start positions, m, in frame 0 of each arm."""
    settings = scenario.task
    arms = settings.arms or scenario.arms
    start_tips: Tips = {arm: protocol.to_world(arm, tips[arm]) for arm in scenario.arms}
    x, y = (sum(start_tips[arm][axis] for arm in arms) / len(arms) for axis in (0, 1))
    workspace = Workspace(tuple(arms), start_tips, (x, y), seed)
    kinds = {"reach": ReachTask, "peg_transfer": PegTask, "path": PathTask, "levels": LevelsTask}
    return kinds.get(settings.kind, Task)(settings, workspace)
