"""Defines a check: its name, the unit of its margin, its input, and what it does when it trips.

A robot has built-in checks. A campaign may add users' checks: Python files at a seam of the tick.
"""

import dataclasses
import re
from collections.abc import Iterable
from typing import Literal, NamedTuple

from ravenjax.vocabulary.parts import OwnSource

Action = Literal["stop", "flag", "limit", "watch"]
"""Action of a check when it trips.

It stops the robot (stop), raises an alarm (flag), or changes a command or drops a packet without an
alarm (limit). A user's check may also only watch.
"""

DOES: dict[Action, str] = {
    "stop": "stops the robot",
    "flag": "raises an alarm",
    "limit": "limits without an alarm",
    "watch": "only watches",
}
"""Description of each action."""
_RESPONSES = dict(zip(DOES, ("stopped", "flagged", "limited", "silent"), strict=True))

OWN = "own_"
"""Prefix of the names of users' checks in columns and causes."""


@dataclasses.dataclass(frozen=True)
class CheckUse:
    """One user's check of a campaign; static."""

    name: str
    part: OwnSource
    at: str  # seam at which the check acts, one of `Robot.check_seams`
    acts: Action
    consecutive: int = 1  # number of consecutive ticks above the threshold before the check trips


class Check(NamedTuple):
    """One built-in check, or one user's check."""

    name: str
    unit: str  # unit of its margin, the distance from its limit
    meaning: str
    action: Action
    cause: str = ""  # name of the check as the cause of a stop; "": its name
    follows: bool = False  # True if it also trips after another check stopped the robot

    @property
    def named_cause(self) -> str:
        """The check's name in the column response_cause."""
        return self.cause or self.name

    @property
    def does(self) -> str:
        """Description of the check's action."""
        return DOES[self.action]

    @property
    def response(self) -> str:
        """Response (see `outcomes.verdict`) of a run whose strongest check that trips is this."""
        return _RESPONSES[self.action]

    @property
    def own(self) -> bool:
        """Whether this is a user's check."""
        return self.name.startswith(OWN)

    @property
    def acts(self) -> bool:
        """Whether the action of the check changes the robot's motion."""
        return self.action in ("stop", "limit")


def of_own(name: str, at: str, acts: Action) -> Check:
    """Return the description of a user's check for tables."""
    return Check(f"{OWN}{name}", "of its score", f"user's check at {at}", acts)


BUILT_IN = "built_in_response"
"""Column with the response of the built-in checks alone, if `response` includes added checks."""


def needs_own_columns(added: Iterable[Check], stops: bool) -> bool:
    """Return whether the response of the built-in checks alone needs separate columns. added:
    users' checks; checks that only watch need no columns. stops: a detector may stop the robot.
    """
    return stops or any(check.action != "watch" for check in added)


def built_in_column(added: Iterable[Check], stops: bool) -> str:
    """Return the column with the response of the built-in checks alone; see `needs_own_columns`."""
    return BUILT_IN if needs_own_columns(added, stops) else "response"


def check_names(columns: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the checks with a column `check_<name>_count`, in order."""
    matches = (re.fullmatch("check_(.+)_count", column) for column in columns)
    return tuple(match[1] for match in matches if match)
