"""A built-in check of a robot: name, unit of the margin, what a check looks at, and what it does when it trips."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

Action = Literal["stop", "flag", "limit"]
"""What a check does when it trips: the robot stops; a person is told; a command is changed or a packet dropped."""

DOES: dict[Action, str] = {"stop": "stops the robot", "flag": "tells a person", "limit": "limits, tells nobody"}
"""Each in words."""


class Check(NamedTuple):
    """One built-in check."""

    name: str
    unit: str  # of its margin
    meaning: str
    action: Action
    cause: str = ""  # its name as the cause of a stop

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
        """What a run is called in which it trips and nothing stronger does: a word of `outcomes.verdict.RESPONSES`."""
        return _RESPONSES[self.action]


_RESPONSES: dict[Action, str] = {"stop": "stopped", "flag": "flagged", "limit": "limited"}


def names(columns: Iterable[str]) -> tuple[str, ...]:
    """Names of the checks among outcome columns."""
    return tuple(c.removeprefix("check_").removesuffix("_count") for c in columns if _counts(c))


def count_columns(columns: Iterable[str]) -> tuple[str, ...]:
    """Those outcome columns that say how often a check tripped."""
    return tuple(c for c in columns if _counts(c))


def _counts(column: str) -> bool:
    return column.startswith("check_") and column.endswith("_count")
