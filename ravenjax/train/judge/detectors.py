"""Trips of the robot's built-in checks during a session, from the outcomes of robot and golden
run so far; and how fast the hands go, and whether they have slowed down.

Hands also slow down where they arrive, so a slow-down counts only if it lasts: longer than a tip is
held at a target. Its time is that of its beginning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ravenjax.robots.raven2 import ROBOT
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.checks import Check

SLOW_SHARE = 0.25
"""Share of the usual speed before the hazard; `stages.reaction` has operators slow down to it."""
SLOW_FOR_MS = 1000
"""As long, without a break, before it counts."""
MOVING_MM_S = 2.0
"""Slower hands, as tip motion, have nothing to slow down."""
# 1/ms, of running means: over some targets, over a twitch.
_USUAL, _PRESENT = 1.0 / 2000.0, 1.0 / 50.0
_QUICK, _SLOW_AT_STRIKE = -1, -2
QUIET_MS = 1000
"""A check that keeps tripping is announced again only after so long without a trip."""


class Trip(NamedTuple):
    """A check that tripped since the last look."""

    check: Check
    ms: int  # of the session; exact for the check's first trip of the run, else that of the look
    beyond_golden: bool  # it has tripped more often than in the golden run by now
    announced: bool  # not for `QUIET_MS` before
    count: int  # in the session so far


class Trips:
    """How often each check has tripped; `look` every few milliseconds."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._earlier: dict[str, int] = {}  # before the robot last began anew
        self._last: dict[str, int] = {}  # session's ms of the last trip

    def look(
        self,
        tick: int,
        robot_tick: int,
        outcomes: Mapping[str, Any],
        golden: Mapping[str, Any] | None = None,
    ) -> list[Trip]:
        """Each check that tripped since the last look, the earliest first.

        tick, robot_tick: ms of session and robot. outcomes, golden: `check_*` columns of a
        campaign, of robot and golden run so far; golden None: there is none, every trip counts.
        """
        trips = []
        for name in checks.names(outcomes):
            count, before = int(outcomes[f"check_{name}_count"]), self._counts.get(name, 0)
            self._counts[name] = count
            if count <= before:
                continue
            ms = tick
            if before == 0 and (first := int(outcomes.get(f"check_{name}_first_ms", -1))) >= 0:
                ms = tick - (robot_tick - first)
            usual = 0 if golden is None else int(golden[f"check_{name}_count"])
            announced = ms - self._last.get(name, -math.inf) > QUIET_MS
            total = self._earlier.get(name, 0) + count
            trips.append(Trip(ROBOT.check(name), ms, count > usual, announced, total))
            self._last[name] = tick
        return sorted(trips, key=lambda trip: trip.ms)

    def reset(self) -> None:
        """The robot was restarted, and its counts with it."""
        for name, count in self._counts.items():
            self._earlier[name] = self._earlier.get(name, 0) + count
        self._counts = {}


class SlowdownDetector:
    """Running means of the hands' speed as tip motion, mm/s, both hands together."""

    __slots__ = ("_before", "_limit", "_scale", "_since", "present", "slowed", "usual")

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._before: list[float] | None = None
        self.usual = self.present = 0.0
        # mm/s; the hands are slow below it.
        self._limit = 0.0
        # The tick since which they are slow.
        self._since = _QUICK
        self.slowed = -1
        """Tick in which a slow-down that lasts began; -1: there is none."""

    def step(self, tick: int, hands: list[float]) -> None:
        """hands: um before scaling, three numbers a hand; once a tick."""
        before, self._before = self._before, hands
        if before is None:
            return
        # um/ms is mm/s
        speed = self._scale * math.dist(hands, before)
        self.usual += _USUAL * (speed - self.usual)
        self.present += _PRESENT * (speed - self.present)
        if self.present >= self._limit:
            self._since, self.slowed = _QUICK, -1
        elif self._since == _QUICK:
            self._since = tick
        elif self._since >= 0 and tick - self._since >= SLOW_FOR_MS:
            self.slowed = self._since

    def strike(self) -> None:
        """From now on slowing down is measured against the speed of now."""
        self._limit = SLOW_SHARE * self.usual if self.usual > MOVING_MM_S else 0.0
        self._since = _SLOW_AT_STRIKE if self.present < self._limit else _QUICK
        self.slowed = -1

    def jump(self) -> None:
        """The hands were put elsewhere."""
        self._before = None
