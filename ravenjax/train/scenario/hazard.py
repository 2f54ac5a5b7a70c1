"""Describes a hazard that a session can arm, and the response expected."""

import dataclasses
from typing import Any

from ravenjax.hazards.library import Hazard
from ravenjax.train.scenario.config import Entry

RESPONSES: dict[str, tuple[str, ...]] = {
    "temporarily unavailable": ("restart",),
    "permanently unavailable": ("convert", "stop"),
    "sudden jump": ("release", "slow", "stop"),
}
"""Right responses to the three hazards of IROS 2016, table 1. They are: restart and troubleshoot;
convert, reschedule and report; release the pedal, slow down, stop.
"""

MOVING = ("jump", "displaced", "withheld", "unpublished")
"""Expected outcomes in which the instrument may move, as in a sudden jump."""

ENDLESS_MS = 5000
"""How long a fault without an end stays active, unless the scenario sets a time."""

SETTLE_MS = 500
"""A hazard is watched for this much longer than the time allowed for the response."""


@dataclasses.dataclass(frozen=True)
class Armable:
    """One hazard of a session's list."""

    # Its index in the session's list, and its row in the fault table.
    number: int
    # Id in the library; "fault" where the scenario declares the fault itself.
    hazard: str
    title: str
    # Name of the fault table's group.
    group: str
    # 16 hex digits.
    run_id: str
    # The arm on which the first fault acts; "" where the fault is not on an arm.
    arm: str
    right_response: tuple[str, ...]
    within_s: float
    # How long the fault stays active.
    lasts_ms: int
    # Earliest and latest time; None: the instructor arms the hazard.
    when_ms: tuple[float, float] | None
    # Layer of the loop, in words; "" where the scenario declares the fault itself.
    layer: str

    def header(self) -> dict[str, Any]:
        """Return the hazard's entry in session.json."""
        hidden = ("arm", "lasts_ms", "when_ms")
        return {key: value for key, value in vars(self).items() if key not in hidden}


def right_responses(entry: Entry, hazard: Hazard | None) -> tuple[str, ...]:
    """Return the scenario's right responses; without any, those of the library's row."""
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
"""Used in place of a library id where the scenario declares the fault itself."""
