"""Detects trips of the robot's checks during a session, and whether the hands slow down.

Hands also slow down where they arrive, so a slow-down counts only if it lasts longer than a tip is
held at a target. Its time is that of its beginning.
"""

import math
from typing import NamedTuple

from ravenjax.train.protocol.messages import Json
from ravenjax.train.robot import ROBOT
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.checks import Check

SLOW_SHARE = 0.25
"""Hands are slow below this share of their usual speed before the hazard (`stages.reaction`)."""
SLOW_FOR_MS = 1000
"""A slow-down counts only if it lasts this long without a break."""
MOVING_MM_S = 2.0
"""Hands below this speed, as tip motion, have no speed to reduce."""
# Rates of the running means of the usual and the present speed, 1/ms.
_USUAL, _PRESENT = 1.0 / 2000.0, 1.0 / 50.0
_QUICK, _SLOW_AT_STRIKE = -1, -2
QUIET_MS = 1000
"""A check that keeps tripping is announced again only after this time without a trip."""


class Trip(NamedTuple):
    """A trip of a check since the last reading."""

    check: Check
    # ms of the session: exact for a check's first trip, otherwise the time of the reading.
    ms: int
    # Whether it has tripped more often so far than in the golden run.
    beyond_golden: bool
    announced: bool  # the first after `QUIET_MS` without one
    count: int  # in the session so far


class Trips:
    """Counts the trips of each check. Call `look` every few milliseconds."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._earlier: dict[str, int] = {}  # trips before the robot's last restart
        self._last: dict[str, int] = {}  # tick of each check's last trip

    def look(
        self, tick: int, robot_tick: int, outcomes: Json, golden: Json | None = None
    ) -> list[Trip]:
        """Return each check that tripped since the last reading, the earliest first.

        tick, robot_tick: ms of session and robot. outcomes, golden: `check_*` columns of robot and
        golden run so far. Without a golden run every trip counts.
        """
        trips = []
        for name in checks.check_names(outcomes):
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
        for name, count in self._counts.items():
            self._earlier[name] = self._earlier.get(name, 0) + count
        self._counts = {}


class SlowdownDetector:
    """Running means of the hands' speed as tip motion, mm/s, both hands together."""

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._before: list[float] | None = None
        self.usual = self.present = 0.0
        # mm/s; the hands are slow below this limit.
        self._limit = 0.0
        # The tick since which the hands are slow.
        self._since = _QUICK
        self.slowed = -1
        """Tick at which a lasting slow-down began; -1 without one."""

    def step(self, tick: int, hands: list[float]) -> None:
        """Take the hands' positions of a tick: um before scaling, three numbers a hand."""
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
        """Measure slow-downs against the usual speed before the hazard that becomes active now."""
        self._limit = SLOW_SHARE * self.usual if self.usual > MOVING_MM_S else 0.0
        self._since = _SLOW_AT_STRIKE if self.present < self._limit else _QUICK
        self.slowed = -1

    def jump(self) -> None:
        """Ignore the next step of the hands, because they were moved to another position."""
        self._before = None
