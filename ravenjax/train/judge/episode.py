"""One hazard of a session, from arming to disarming: the effect on the robot, the response, the
score.

docs/outcomes.md defines the outcomes and the terms of checks and motion. Effects are measured
against the golden run, which starts at the robot's state when the hazard is armed. The limit of
motion hazards is the scenario's `[harm] excursion_mm`. The columns `unintended_mm` to
`false_report_first_ms` equal the result table's columns of these names, from the hazard's
activation on.

**First possible knowledge** (`knowable_ms`): the first tick at which a person at the console could
know of the hazard. Seen: the tip, reported or true, is `SEEN_MM` or more from where it would be
without the fault ("tip"), or the robot left pedal-down on its own ("runlevel"). Announced: a check
raised an alarm (the check's name). A difference that only a computer can measure is not knowledge.
The cue is felt from its onset: at its published threshold it begins with a quarter of its largest
force. Reaction times count from their *origin*: the earliest of knowledge, cue and alarm. Nobody is
blamed for effects until `ACTS_MS` after it (`unavoidable`).

**Response**: the operator's first right response after the origin and within the time for it, or
else the first response of another kind. An operator who slows down may only have arrived, so a
slow-down counts only where it is a right response.

**Interrupted**: others cut the hazard off before it was decided. They pause, reset, disarm or end
the session, press the E-stop or hand the console over, or a console or link fails. Neither the
hazard nor a later response is scored. A hazard is decided once harm is done, a right response is
given, or the time for one is up. An operator who gives the console away or leaves cuts nothing off:
a pedal that was down counts as released.

**Score**: 50 points for the response and 50 for the patient. Response: 50 points up to
`FASTEST_MS`, from there down to 25 at the end of the time allowed, 0 without a right response.
Patient: take the distance to harm that remained when a person could first have acted. The points
are 50 times the share of it that still remains at the end, the smaller share of unintended motion
and depth. If harm was done before a person could act, the whole distance counts.

**Times** of a row are ms since the session began, except: `reaction_ms` counts from the origin
above, `halted_ms` and `golden_halted_ms` (the golden run's) are durations.
"""

import dataclasses
import math
from typing import Annotated, Any

import numpy as np
import pydantic
from pydantic import BeforeValidator

from ravenjax.outcomes import verdict
from ravenjax.train.protocol import Json
from ravenjax.train.scenario import Armable, Harm
from ravenjax.vocabulary.checks import Check

Text = Annotated[str, BeforeValidator(lambda value: "" if value is None else str(value))]
Flag = Annotated[bool, BeforeValidator(lambda value: value or False)]
KNOWN_WHEN_ARMED = ("number", "hazard", "title", "right_response", "armed_ms", "limit_mm", "cue")
"""Columns that the event "hazard_armed" has."""
AFFECTED_MM = 1.0
"""A distance that counts as an effect: the jump as expert surgeons defined it (DSN'16, text)."""
SEEN_MM = AFFECTED_MM
"""A distance that a person at the console can see while the tip moves: the surgeons' jump.

This is an assumption. An eye at 0.6 m resolves 0.2 mm on the screen, but sees no golden run.
"""
ACTS_MS = 150.0
"""The earliest that a person can act: a simple reaction to a touch takes 150 to 300 ms."""
FASTEST_MS = 250.0
"""Reactions up to this time lose no points; `stages.reaction` assumes the same value."""
CONTINUE = "continue"
DISTANCES = ("unintended", "loss", "false_report")
"""Distances in the frame (`<name>_mm`) that are a hazard if they exceed the limit."""
PEAKS = (*DISTANCES, "unintended_off")
"""Distances whose largest value an episode keeps."""


def _number_or_none(value: Any) -> float | None:
    try:
        number = math.nan if value in (None, "") else float(value)
    except ValueError:
        raise ValueError("expected a number or nothing") from None
    return number if math.isfinite(number) else None


Number = Annotated[float | None, BeforeValidator(_number_or_none)]


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


COLUMNS = tuple(field.name for field in dataclasses.fields(HazardRow))
"""Columns of hazards.csv, in order."""


class Episode:
    """One hazard from arming to disarming."""

    def __init__(self, hazard: Armable, harm: Harm, tick: int, cue_on: bool) -> None:
        self.hazard, self.harm = hazard, harm
        self.cue_on = cue_on
        self.armed_ms = tick
        self.struck_ms: int | None = None
        self.knowable_ms: int | None = None
        self.knowable_by = ""
        self.cue_ms: int | None = None
        # ms and name of the first check of each kind of response
        self.checks: dict[str, tuple[int, str]] = {}
        # The earliest of knowledge, cue and alarm.
        self.origin_ms: int | None = None
        self.halted = False
        self.halted_ms, self.golden_halted_ms = 0, 0
        # The arm on which the fault acts, otherwise the arm that moved farthest.
        self.arm = hazard.arm
        self.peak_error_mm = 0.0
        # -1: not measured
        self.peak_mm: dict[str, float] = dict.fromkeys(PEAKS, -1.0)
        # When one of `DISTANCES` first exceeded the limit.
        self.first_ms: dict[str, int] = {}
        self.deepest_mm = -math.inf
        # Unintended motion and depth that the fault caused, the limits of both, and the part caused
        # before a person could have acted.
        self._done_mm, self._spared_mm = [0.0, 0.0], [0.0, 0.0]
        self._limits_mm = harm.excursion_mm, harm.depth_mm
        self._is_lost = False
        # ms of the first response of each kind.
        self.responses: dict[str, int] = {}
        self.interrupted = False

    @property
    def struck(self) -> bool:
        return self.struck_ms is not None

    @property
    def check_response(self) -> str:
        """The checks' response, one of `verdict.RESPONSES`."""
        return next((word for word in verdict.RESPONSES if word in self.checks), "silent")

    def know(self, tick: int, by: str) -> None:
        """Record that the hazard could be known from this tick on."""
        self.knowable_ms, self.knowable_by = tick, by
        self._originate(tick)

    def feel(self, tick: int) -> None:
        """Record that the operator felt the cue."""
        self.cue_ms = tick
        self._originate(tick)

    def trip(self, tick: int, check: Check) -> bool:
        """Record a trip beyond the golden run's. Return whether it is the first of its response."""
        if check.response in self.checks:
            return False
        self.checks[check.response] = tick, check.name
        if check.response in verdict.TOLD:
            self._originate(tick)
        return True

    def exceed(self, tick: int, name: str, mm: float, arm: str) -> bool:
        """Record a new peak of one of `PEAKS`. Return whether its limit is first exceeded now."""
        self.peak_mm[name] = mm
        if name.startswith("unintended") and mm > self._done_mm[0] and not self.hazard.arm:
            self.arm = arm
        self._do(tick, 0, max(self.peak_mm["unintended"], self.peak_mm["unintended_off"]))
        if name in DISTANCES and mm > self.harm.excursion_mm and name not in self.first_ms:
            self.first_ms[name] = tick
            return True
        return False

    def drive(self, tick: int, mm: float) -> None:
        """Record the depth that the fault has added since its activation."""
        self._do(tick, 1, mm)

    def halt(self, halted_ms: int, golden_halted_ms: int) -> bool:
        """Record the times of a held pedal without motion. Return whether the loss is new."""
        was_lost = self._is_lost
        self.halted_ms, self.golden_halted_ms = halted_ms, golden_halted_ms
        stopped = self.check_response == "stopped"
        self._is_lost = bool(verdict.is_halt(halted_ms, golden_halted_ms, stopped))
        return self._is_lost and not was_lost

    def respond(self, tick: int, what: str) -> bool:
        """Record a response, if it is the first of its kind after the origin. Return that."""
        known = self.origin_ms is not None and tick >= self.origin_ms
        if self.interrupted or not known or what in self.responses:
            return False
        self.responses[what] = tick
        return True

    def decided(self, tick: int) -> bool:
        """Whether nothing can improve the outcome: after harm, a right response, or the time."""
        if self._exceeds(self._done_mm) and not self._exceeds(self._spared_mm):
            return True
        is_late = self.origin_ms is not None and tick - self.origin_ms > self._within_ms
        if CONTINUE in self.hazard.right_response:
            return is_late or any(what != "slow" for what in self.responses)
        return is_late or self.answer()[1]

    def interrupt(self, tick: int) -> bool:
        """Record that others cut the hazard off. Return whether it was undecided until now."""
        if not self.struck or self.interrupted or self.decided(tick):
            return False
        self.interrupted = True
        return True

    def right(self, what: str) -> bool:
        """Whether this response, once given, is right and in time."""
        return what in self.hazard.right_response and self.reaction_ms(what) <= self._within_ms

    def reaction_ms(self, what: str) -> int:
        """Return the time from the origin to a response that was given."""
        return self.responses[what] - (self.origin_ms or 0)

    def answer(self) -> tuple[str, bool]:
        """Return the response that counts ("" if none) and whether it is right and in time."""
        in_order = sorted(self.responses, key=self.responses.__getitem__)
        first = next((what for what in in_order if what != "slow"), "")
        if CONTINUE in self.hazard.right_response:
            return (first, False) if first else (CONTINUE, self.struck and not self.halted)
        right = next((what for what in in_order if self.right(what)), "")
        return (right, True) if right else (first, False)

    def motion_hazard(self) -> str:
        """Return the motion hazard, one of `verdict.HAZARDS`."""
        columns = {f"{name}_first_ms": [self.first_ms.get(name, -1)] for name in DISTANCES}
        columns |= {"halted_ms": [self.halted_ms], "golden_halted_ms": [self.golden_halted_ms]}
        (place,) = verdict.classify_hazards(columns, np.array([self.check_response == "stopped"]))
        return verdict.HAZARDS[place]

    def outcome(self) -> str:
        """Return one of interrupted, unavoidable, harm, avoided, halted, unaffected, missed."""
        if self.interrupted:
            return "interrupted"
        if self._exceeds(self._spared_mm):
            return "unavoidable"
        if self._exceeds(self._done_mm):
            return "harm"
        if self.answer()[1]:
            return "avoided"
        if self.halted:
            return "halted"
        is_small = max(self.peak_mm.values()) < AFFECTED_MM
        if is_small and self.cue_ms is None and self.motion_hazard() == "none":
            return "unaffected"
        return "missed"

    def score(self) -> float | None:
        """Return the score, 0 to 100, or None if the hazard is unaffected or interrupted."""
        if self.outcome() in ("unaffected", "interrupted"):
            return None
        what, ok = self.answer()
        response = 0.0
        if ok:
            longest = max(self._within_ms - FASTEST_MS, 1.0)
            late = 0.0 if what == CONTINUE else max(self.reaction_ms(what) - FASTEST_MS, 0.0)
            response = 1.0 - 0.5 * min(late / longest, 1.0)
        # The share used of the distance to a limit that remained when a person could act. If
        # nothing remained then, the share used of the whole distance.
        used = max(
            (done - spared) / (limit - spared if spared < limit else limit)
            for done, spared, limit in zip(
                self._done_mm, self._spared_mm, self._limits_mm, strict=True
            )
        )
        return round(50.0 * response + 50.0 * max(0.0, 1.0 - used), 1)

    def row(self) -> Json:
        """Return the hazard's columns of hazards.csv."""
        what, ok = self.answer()
        answered = what in self.responses
        # Of two alarms at the same time, the stronger comes first.
        alarms = [self.checks[word] for word in verdict.TOLD if word in self.checks]
        alarm_ms, alarm = min(alarms, key=lambda alarm: alarm[0], default=(None, None))
        limited_ms, limited = self.checks.get("limited", (None, None))
        times = ("arm", "armed_ms", "struck_ms", "knowable_ms", "cue_ms", "halted")
        row = {name: getattr(self.hazard, name) for name in ("number", "hazard", "title")}
        row |= {name: getattr(self, name) for name in times} | {
            "cue": "on" if self.cue_on else "off",
            "knowable_by": self.knowable_by or None,
            "alarm_ms": alarm_ms,
            "alarm": alarm,
            "limited_ms": limited_ms,
            "limited": limited,
            "limit_mm": self.harm.excursion_mm,
            "response": what or None,
            "response_ms": self.responses[what] if answered else None,
            "reaction_ms": self.reaction_ms(what) if answered else None,
            "right_response": " ".join(self.hazard.right_response),
            "response_ok": ok,
            "outcome": self.outcome(),
            "score": self.score(),
        }
        if not self.struck:
            return row
        peaks = self.peak_mm.items()
        return row | {
            "check_response": self.check_response,
            "check_cause": self.checks.get(self.check_response, (None, None))[1],
            "motion_hazard": self.motion_hazard(),
            **{f"{name}_mm": round(mm, 4) if mm >= 0.0 else None for name, mm in peaks},
            **{f"{name}_first_ms": self.first_ms.get(name) for name in DISTANCES},
            "halted_ms": self.halted_ms,
            "golden_halted_ms": self.golden_halted_ms,
            "peak_error_mm": round(self.peak_error_mm, 4),
            "deepest_mm": round(self.deepest_mm, 4) if math.isfinite(self.deepest_mm) else None,
        }

    @property
    def _within_ms(self) -> float:
        return self.hazard.within_s * 1000.0

    def _exceeds(self, amounts_mm: list[float]) -> bool:
        return any(mm > limit for mm, limit in zip(amounts_mm, self._limits_mm, strict=True))

    def _do(self, tick: int, kind: int, mm: float) -> None:
        self._done_mm[kind] = max(self._done_mm[kind], mm)
        if self.origin_ms is None or tick < self.origin_ms + ACTS_MS:
            self._spared_mm[kind] = self._done_mm[kind]

    def _originate(self, tick: int) -> None:
        if self.origin_ms is None or tick < self.origin_ms:
            self.origin_ms = tick
