"""A hazard as a session has it: one row of the fault table that can be armed, and what it asks
of the operator.
"""

from __future__ import annotations

import dataclasses
from typing import Any

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

    # Its place in the list, and its row of the fault table.
    number: int
    # Id of the library; "fault" where the scenario wrote the fault itself.
    hazard: str
    title: str
    # Of the fault table.
    group: str
    # 16 hex digits.
    run_id: str
    # That is struck first; "" where the fault is on no arm.
    arm: str
    right_response: tuple[str, ...]
    within_s: float
    # How long it is left at work.
    lasts_ms: int
    # Earliest and latest; None: the instructor arms it.
    when_ms: tuple[float, float] | None
    # Of the loop, in words; "" where the scenario wrote the fault itself.
    layer: str

    def header(self) -> dict[str, Any]:
        """What session.json says of it."""
        names = ("number", "hazard", "title", "group", "run_id", "within_s", "layer")
        fields = {name: getattr(self, name) for name in names}
        return fields | {"right_response": list(self.right_response)}


def responses(entry: Entry, hazard: Hazard | None) -> tuple[str, ...]:
    """The right responses: the scenario's, else those that the library's row asks for."""
    if entry.right_response is not None:
        return entry.right_response
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


FAULT = "fault"
"""In place of a library's id."""
