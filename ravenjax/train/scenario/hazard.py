"""A hazard as a session has it: one row of the fault table that can be armed, and what it asks
of the operator.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from ravenjax.hazards import library
from ravenjax.hazards.library import Hazard
from ravenjax.train.scenario.config import Entry

RESPONSES: dict[str, tuple[str, ...]] = {
    "temporarily unavailable": ("restart",),
    "permanently unavailable": ("convert", "stop"),
    "sudden jump": ("release", "slow", "stop"),
}
"""What the operator must learn of each of the three hazards of IROS 2016, table 1: restart and
troubleshoot; convert, reschedule and report; release the pedal, slow down, stop."""

MOVING = ("jump", "displaced", "withheld", "unpublished")
"""Expected outcomes in which the instrument may move: to be met like a sudden jump."""

ENDLESS_MS = 5000
"""How long a fault without an end stays at work unless the scenario says otherwise; longer than
any response takes.
"""

SETTLE_MS = 500
"""A hazard is watched so much longer than the time for the response."""


@dataclasses.dataclass(frozen=True)
class Armable:
    """One hazard of a session's list."""

    number: int  # its place in the list
    hazard: str  # id of the library; "fault" where the scenario wrote the fault itself
    title: str
    group: str  # of the fault table
    run_id: str  # 16 hex digits
    row: int  # of the fault table
    arm: str  # that is struck first; "" where the fault is on no arm
    right_response: tuple[str, ...]
    within_s: float
    duration_ms: (
        int | None
    )  # of the fault's windows, from the first's opening to the last's end; None: no end
    lasts_ms: int  # how long it is left at work
    when_ms: tuple[float, float] | None  # earliest and latest; None: the instructor arms it

    def header(self) -> dict[str, Any]:
        """What session.json says of it."""
        names = ("number", "hazard", "title", "group", "run_id", "within_s")
        row = of_library(self.hazard)
        layer = library.layers()[row.layer] if row is not None else ""
        fields = {name: getattr(self, name) for name in names}
        return fields | {"right_response": list(self.right_response), "layer": layer}


def responses(entry: Entry, hazard: Hazard | None) -> tuple[str, ...]:
    """The right responses: the scenario's, else those that the library's row asks for."""
    if entry.right_response is not None:
        return tuple(entry.right_response)
    if hazard is None:
        return RESPONSES["sudden jump"]
    if hazard.scenarios:
        return tuple(dict.fromkeys(word for name in hazard.scenarios for word in RESPONSES[name]))
    if any(word in MOVING for word in hazard.expected_class):
        return RESPONSES["sudden jump"]
    if "stop" in hazard.expected_class:
        return RESPONSES["temporarily unavailable"]
    if "unresponsive" in hazard.expected_class:
        return RESPONSES["permanently unavailable"]
    return ("continue",)


def lasts_ms(entry: Entry, duration_ms: int | None) -> int:
    """How long it is left at work: its own time and the time to respond; the scenario may say
    less or more.
    """
    if entry.lasts_s is not None:
        return round(entry.lasts_s * 1000.0)
    response = round(entry.within_s * 1000.0) + SETTLE_MS
    return max(response, ENDLESS_MS if duration_ms is None else duration_ms)


def named(group: str) -> tuple[str, str, str]:
    """Of a group's name ENTRY/ID-CASE#TIME: entry, ID, case; the library's ids hold no hyphen."""
    entry, _, rest = group.partition("/")
    words, _, _ = rest.partition("#")
    hazard, _, case = words.partition("-")
    return entry, hazard, case


def of_library(name: str) -> Hazard | None:
    """The library's row, None where the scenario wrote the fault itself."""
    return None if name == FAULT else library.find(name)


FAULT = "fault"
"""In place of a library's id."""
