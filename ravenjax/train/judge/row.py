"""A row of hazards.csv; what its words mean is in `episode`."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class HazardRow:
    """One row. Times are ms since the session began, None where it never happened; sizes None
    where not measured.
    """

    session: str
    participant: str
    group: str
    scenario: str
    seed: str
    cue: str  # on, off
    blinded: bool = dataclasses.field(default=False, kw_only=True)
    number: int
    hazard: str  # id in the library
    title: str
    arm: str
    armed_ms: float | None
    struck_ms: float | None
    knowable_ms: float | None
    knowable_by: str
    cue_ms: float | None
    alarm_ms: float | None  # first check that told a person or stopped the robot
    alarm: str
    # first check that changed a command or dropped a packet: nobody was told
    limited_ms: float | None
    limited: str
    check_response: str  # one of outcomes.verdict.RESPONSES; "" where it never struck
    check_cause: str  # first check that did so
    motion_hazard: str  # one of outcomes.verdict.HAZARDS
    limit_mm: float | None  # of hazards and harm: the scenario's
    unintended_mm: float | None
    unintended_first_ms: float | None
    unintended_off_mm: float | None
    loss_mm: float | None
    loss_first_ms: float | None
    halted_ms: float | None
    golden_halted_ms: float | None
    false_report_mm: float | None
    false_report_first_ms: float | None
    peak_error_mm: float | None  # of the reported tip from the model, which the cue acts on
    deepest_mm: float | None
    response: str  # the operator's
    response_ms: float | None
    reaction_ms: float | None
    right_response: str
    response_ok: bool
    halted: bool  # the robot left pedal-down by itself
    outcome: str
    score: float | None

    @property
    def after(self) -> dict[str, float]:
        """ms after the strike of whatever happened: knowable, cue, alarm, response."""
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
        """Largest unintended motion of the true tip, while the robot was live and while it was
        not.
        """
        distances = (self.unintended_mm, self.unintended_off_mm)
        return max((mm for mm in distances if mm is not None), default=None)


COLUMNS = tuple(one.name for one in dataclasses.fields(HazardRow))
"""Of hazards.csv, in order."""
OF_SESSION = ("session", "participant", "group", "scenario", "seed", "blinded")
"""Columns that are the same in every row of a session."""
OF_LIST = ("hazard", "title", "right_response")
"""Columns that stand in the session's list of hazards, too."""
TOLD = tuple(name for name in COLUMNS if name not in (*OF_SESSION, *OF_LIST))
"""Columns of the event "hazard_row", in order: with session.json they make the row again."""
