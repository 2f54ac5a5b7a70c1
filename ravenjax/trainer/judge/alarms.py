"""The robot's own checks, as the outcomes of the run so far show them: which tripped since the last look."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

QUIET_MS = 1000
"""A check that keeps tripping is told again only after so long without."""


class Alarms:
    """Counts of every check; `look` every few milliseconds."""

    def __init__(self) -> None:
        self._columns: list[tuple[str, str, str]] = []  # check, column of its count, of its first trip
        self._counts: dict[str, int] = {}
        self._last: dict[str, int] = {}  # session's tick of the last trip

    def look(self, tick: int, robot_tick: int, outcomes: Mapping[str, Any]) -> list[tuple[str, int, bool]]:
        """(check, ms of the session, whether to tell) of each that tripped since the last look, earliest first.

        The ms is exact for the first trip ever, which the robot remembers, else that of this look.
        """
        if not self._columns:
            names = [name[len("check_") : -len("_count")] for name in outcomes if _counts(name)]
            self._columns = [(name, f"check_{name}_count", f"check_{name}_first_ms") for name in names]
        found = []
        for check, count_column, first_column in self._columns:
            count = int(outcomes[count_column])
            before = self._counts.get(check, 0)
            self._counts[check] = count
            if count > before:
                at = tick
                if before == 0 and (first := int(outcomes.get(first_column, -1))) >= 0:
                    at = tick - (robot_tick - first)
                found.append((check, at, at - self._last.get(check, -math.inf) > QUIET_MS))
                self._last[check] = tick
        return sorted(found, key=lambda trip: trip[1])

    def reset(self) -> None:
        """The robot begins anew, and its counts with it."""
        self._counts = {}


def _counts(name: str) -> bool:
    return name.startswith("check_") and name.endswith("_count")
