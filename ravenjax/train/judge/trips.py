"""Trips of the robot's built-in checks during a session, from the outcomes of robot and golden
run so far.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ravenjax.robots.raven2 import ROBOT
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.checks import Check

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
        """The robot begins anew, and its counts with it."""
        for name, count in self._counts.items():
            self._earlier[name] = self._earlier.get(name, 0) + count
        self._counts = {}
