"""Defines the rows of hazards.csv. `episode` explains their terms."""

import dataclasses
import math
from typing import Annotated, Any

import pydantic
from pydantic import BeforeValidator


def _number_or_none(value: Any) -> float | None:
    try:
        number = math.nan if value in (None, "") else float(value)
    except ValueError:
        raise ValueError("expected a number or nothing") from None
    return number if math.isfinite(number) else None


Number = Annotated[float | None, BeforeValidator(_number_or_none)]
Text = Annotated[str, BeforeValidator(lambda value: "" if value is None else str(value))]
Flag = Annotated[bool, BeforeValidator(lambda value: value or False)]


@pydantic.dataclasses.dataclass(frozen=True, kw_only=True)
class HazardRow:
    """One row of hazards.csv, from a table's cells or from numbers.

    Times are ms since the session began, None if the event never happened. Sizes are None if they
    were not measured.
    """

    session: Text = ""
    participant: Text = ""
    group: Text = ""
    scenario: Text = ""
    seed: Text = ""
    cue: Text = ""  # on, off
    blinded: Flag = False
    number: int
    hazard: Text = ""  # id in the library
    title: Text = ""
    arm: Text = ""
    armed_ms: Number = None
    struck_ms: Number = None
    knowable_ms: Number = None
    knowable_by: Text = ""
    cue_ms: Number = None
    # First check that alerted a person or stopped the robot.
    alarm_ms: Number = None
    alarm: Text = ""
    # First check that changed a command or dropped a packet without alerting anybody.
    limited_ms: Number = None
    limited: Text = ""
    check_response: Text = ""  # one of outcomes.verdict.RESPONSES; "" if never active
    check_cause: Text = ""  # first check with that response
    motion_hazard: Text = ""  # one of outcomes.verdict.HAZARDS
    limit_mm: Number = None  # the scenario's limit of hazards and harm
    unintended_mm: Number = None
    unintended_first_ms: Number = None
    unintended_off_mm: Number = None
    loss_mm: Number = None
    loss_first_ms: Number = None
    halted_ms: Number = None
    golden_halted_ms: Number = None
    false_report_mm: Number = None
    false_report_first_ms: Number = None
    # Distance of the reported tip from the model, which drives the cue.
    peak_error_mm: Number = None
    deepest_mm: Number = None
    response: Text = ""  # the operator's
    response_ms: Number = None
    reaction_ms: Number = None
    right_response: Text = ""
    response_ok: Flag = False
    halted: Flag = False  # the robot left pedal-down on its own
    outcome: Text = ""
    score: Number = None

    @property
    def after(self) -> dict[str, float]:
        """Times of the events that happened, in ms after the activation."""
        if self.struck_ms is None:
            return {}
        times = {
            "knowable": self.knowable_ms,
            "cue": self.cue_ms,
            "alarm": self.alarm_ms,
            "response": self.response_ms,
        }
        return {name: time - self.struck_ms for name, time in times.items() if time is not None}

    @property
    def farthest_mm(self) -> float | None:
        """Largest unintended motion of the true tip, whether the robot was live or not."""
        distances = (self.unintended_mm, self.unintended_off_mm)
        return max((mm for mm in distances if mm is not None), default=None)


COLUMNS = tuple(one.name for one in dataclasses.fields(HazardRow))
"""Columns of hazards.csv, in order."""
KNOWN_WHEN_ARMED = ("number", "hazard", "title", "right_response", "armed_ms", "limit_mm", "cue")
"""Columns that the event "hazard_armed" has."""
