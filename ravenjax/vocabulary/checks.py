"""Defines a check: its name, the unit of its margin, its input, and what it does when it trips.

A robot has built-in checks. A campaign may add users' checks: Python files at a seam of the tick.
"""

import dataclasses
import re
from collections.abc import Iterable
from typing import Literal, NamedTuple

from ravenjax.vocabulary.parts import OwnSource

Action = Literal["stop", "flag", "limit", "watch"]
"""What a check does when it trips.

It stops the robot, raises an alarm, or changes a command or drops a packet without an alarm. A
user's check may also only `watch`.
"""

DOES: dict[Action, str] = {
    "stop": "stops the robot",
    "flag": "raises an alarm",
    "limit": "limits without an alarm",
    "watch": "only watches",
}
"""Each action in words."""
_RESPONSES = dict(zip(DOES, ("stopped", "flagged", "limited", "silent"), strict=True))

OWN = "own_"
"""Prefix of the names of users' checks in columns and causes."""


@dataclasses.dataclass(frozen=True)
class CheckUse:
    """One user's check of a campaign; static."""

    name: str
    part: OwnSource
    at: str  # seam at which it reads, one of `Robot.check_seams`
    acts: Action
    consecutive: int = 1  # milliseconds in a row above the threshold before it trips


class Check(NamedTuple):
    """One check, built in or a user's."""

    name: str
    unit: str  # unit of its margin
    meaning: str
    action: Action
    cause: str = ""  # its name as the cause of a stop; "": none of its own
    follows: bool = False  # it also trips because another check has stopped the robot

    @property
    def named_cause(self) -> str:
        """The check's name in column response_cause."""
        return self.cause or self.name

    @property
    def does(self) -> str:
        """The check's action in words."""
        return DOES[self.action]

    @property
    def response(self) -> str:
        """The response of a run in which this check trips and no check with a stronger action.

        It is one of `outcomes.verdict.RESPONSES`.
        """
        return _RESPONSES[self.action]

    @property
    def own(self) -> bool:
        """Whether this is a user's check."""
        return self.name.startswith(OWN)

    @property
    def acts(self) -> bool:
        """Whether its action changes the robot's motion."""
        return self.action in ("stop", "limit")


def of_own(name: str, at: str, acts: Action) -> Check:
    """Return a user's check as tables need it."""
    return Check(f"{OWN}{name}", "of its score", f"user's check at {at}", acts)


BUILT_IN = "built_in_response"
"""Column of the built-in checks' response, if users' files count in column `response`."""


def needs_own_columns(added: Iterable[Check], stops: bool) -> bool:
    """Return whether the built-in checks' response needs separate columns.

    It does if a user's check does more than watch, or if a detector may stop the robot (`stops`).
    """
    return stops or any(check.action != "watch" for check in added)


def built_in_column(added: Iterable[Check], stops: bool) -> str:
    """Return the column of the built-in checks' response; see `needs_own_columns` for arguments."""
    return BUILT_IN if needs_own_columns(added, stops) else "response"


def check_names(columns: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the checks among outcome columns."""
    found = (re.fullmatch("check_(.+)_count", column) for column in columns)
    return tuple(match[1] for match in found if match)
