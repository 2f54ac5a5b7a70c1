"""What a check is: name, unit of the margin, what it looks at, and what it does when it trips.

A robot has built-in checks. A campaign may add users' checks: Python files at a seam of the tick.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Literal, NamedTuple

from ravenjax.vocabulary.parts import OwnSource

Action = Literal["stop", "flag", "limit", "watch"]
"""What a check does when it trips: the robot stops; a person is told; a command is changed or a
packet dropped; nothing, which only a user's check may do."""

DOES: dict[Action, str] = {
    "stop": "stops the robot",
    "flag": "tells a person",
    "limit": "limits, tells nobody",
    "watch": "watches, does nothing",
}
"""Each in words."""

OWN = "own_"
"""Prefix of the names of users' checks in columns and causes."""


@dataclasses.dataclass(frozen=True)
class CheckUse:
    """One user's check in a campaign; static."""

    name: str
    part: OwnSource
    at: str  # seam, one of `Robot.check_seams`
    acts: Action
    consecutive: int = 1  # milliseconds in a row above the threshold that make it trip


class Check(NamedTuple):
    """One check."""

    name: str
    unit: str  # of its margin
    meaning: str
    action: Action
    cause: str = ""  # its name as the cause of a stop
    follows: bool = False  # it trips, too, because another check has stopped the robot

    @property
    def named_cause(self) -> str:
        """Its name in the column response_cause."""
        return self.cause or self.name

    @property
    def does(self) -> str:
        """Its action in words."""
        return DOES[self.action]

    @property
    def response(self) -> str:
        """What a run is called in which it trips and nothing stronger does: a word of
        `outcomes.verdict.RESPONSES`.
        """
        return _RESPONSES[self.action]

    @property
    def own(self) -> bool:
        """Whether it is a user's check."""
        return self.name.startswith(OWN)

    @property
    def acts(self) -> bool:
        """Whether what it does changes the robot's course."""
        return self.action in ("stop", "limit")


_RESPONSES: dict[Action, str] = {
    "stop": "stopped",
    "flag": "flagged",
    "limit": "limited",
    "watch": "silent",
}


def of_own(name: str, at: str, acts: Action) -> Check:
    """A user's check, for tables."""
    return Check(f"{OWN}{name}", "of its score", f"check of one's own at {at}", acts)


def count(own: Iterable[Check]) -> bool:
    """Whether any of these users' checks counts as a response: it does more than watch."""
    return any(check.action != "watch" for check in own)


BUILT_IN = "built_in_response"
"""Column of the built-in checks' response, where users' files count in the column `response`.
"""


def apart(own: Iterable[Check], stops: bool) -> bool:
    """Whether the built-in checks' response has separate columns.

    It has beside users' checks that count, and beside a detector that may stop the robot (`stops`).
    """
    return stops or count(own)


def built_in_column(own: Iterable[Check], stops: bool) -> str:
    """Column of the built-in checks' response; arguments as in `apart`."""
    return BUILT_IN if apart(own, stops) else "response"


def names(columns: Iterable[str]) -> tuple[str, ...]:
    """Names of the checks among outcome columns."""
    return tuple(c.removeprefix("check_").removesuffix("_count") for c in columns if _counts(c))


def _counts(column: str) -> bool:
    return column.startswith("check_") and column.endswith("_count")
