"""One hazard at work: its times, its peaks, and what follows from them: response, outcome, score.

**First possible knowledge** (`knowable_ms`): the first tick in which what the robot reports could not be without the
fault: its measured tip is more than `KNOWN_MM` from where the fault-free twin's is measured ("tip"), it left
pedal-down by itself ("runlevel"), or a check tripped that had not (its name). Nobody can know
earlier: reaction times count from the earliest of knowledge, cue felt and alarm. Knowledge is never the latest of them,
so they have one origin with the cue and without it.

**Response**: the first right one, from the origin on, within the time for it; else the first of another kind.
Whoever slows down may also have arrived, so a slow-down counts only where it is right.

**Outcome**, the first that holds: `harm`: the true tip strayed by `[harm] stray_mm` or was driven `[harm] depth_mm`
deeper into the tissue; `avoided`: a right response in time; `stopped`: the robot stopped by itself; `unaffected`: no
stray of `AFFECTED_MM`, no cue; else `missed`.

**Score**: 50 for the response and 50 for the patient. Response: 50 up to `FASTEST_MS`, from there down to 25 at the end
of its time, 0 without a right one. Patient: 50 times what is left of the way to harm, 1 - max(stray / stray of harm,
depth / depth of harm). A hazard without effect and without answer is not scored.
"""

from __future__ import annotations

import math
from typing import Any

from ravenjax.trainer.scenario import Armable, Harm

KNOWN_MM = 0.002
"""Resolution of knowledge: measured tips are whole micrometres, truncated along each axis, so that two of the same tip
differ by at most sqrt(3) um."""

AFFECTED_MM = 1.0
"""A stray that counts as an effect: what expert surgeons called a jump (DSN'16, text)."""

FASTEST_MS = 250.0
"""Nothing is taken off for reactions up to it: a simple reaction to a touch takes 150 to 300 ms, and the same as
`stages.reaction` assumes."""

CONTINUE = "continue"

COLUMNS = (
    "session",
    "participant",
    "group",
    "scenario",
    "seed",
    "cue",
    "blinded",
    "number",
    "hazard",
    "title",
    "arm",
    "armed_ms",
    "struck_ms",
    "knowable_ms",
    "knowable_by",
    "cue_ms",
    "alarm_ms",
    "alarm",
    "response",
    "response_ms",
    "reaction_ms",
    "right_response",
    "response_ok",
    "peak_error_mm",
    "peak_stray_mm",
    "deepest_mm",
    "stopped",
    "outcome",
    "score",
)
"""Of hazards.csv, in order. Times are ms since the session began, reaction_ms from the origin above; None is empty."""


class Episode:
    """One hazard from arming until it is taken back."""

    def __init__(self, hazard: Armable, harm: Harm, tick: int, cue_on: bool) -> None:
        self.hazard, self.harm = hazard, harm
        self.cue_on = cue_on
        self.armed_ms = tick
        self.struck_ms: int | None = None
        self.knowable_ms: int | None = None
        self.knowable_by = ""
        self.cue_ms: int | None = None
        self.alarm_ms: int | None = None
        self.alarm = ""
        self.origin_ms: int | None = None  # earliest of the three
        self.stopped = False
        self.strayed = False  # told
        self.arm = hazard.arm  # the struck one, else the one that strayed most
        self.peak_error_mm = 0.0
        self.peak_stray_mm = 0.0
        self.deepest_mm = -math.inf
        self.driven_mm = 0.0  # into the tissue, by the fault
        self.responses: dict[str, int] = {}  # kind -> ms of the first

    @property
    def struck(self) -> bool:
        """Whether the fault has been at work."""
        return self.struck_ms is not None

    def know(self, tick: int, by: str) -> None:
        """From now on, at the latest, it could be known."""
        self.knowable_ms, self.knowable_by = tick, by
        self._originate(tick)

    def feel(self, tick: int) -> None:
        """The operator felt the cue."""
        self.cue_ms = tick
        self._originate(tick)

    def alarmed(self, tick: int, check: str) -> None:
        """A check tripped."""
        self.alarm_ms, self.alarm = tick, check
        self._originate(tick)

    def respond(self, tick: int, what: str) -> bool:
        """Take a response; False where it is none: before anything could be known, or not the first of its kind."""
        if self.origin_ms is None or tick < self.origin_ms or what in self.responses:
            return False
        self.responses[what] = tick
        return True

    def right(self, what: str) -> bool:
        """Whether this response, taken, is right and in time."""
        limit = self.hazard.within_s * 1000.0
        return what in self.hazard.right_response and self.responses[what] - (self.origin_ms or 0) <= limit

    def reaction_ms(self, what: str) -> int:
        """Of a response that was taken."""
        return self.responses[what] - (self.origin_ms or 0)

    def answer(self) -> tuple[str, bool]:
        """The response that counts ("" if none) and whether it is right and in time."""
        in_order = sorted(self.responses, key=self.responses.__getitem__)
        if CONTINUE in self.hazard.right_response:
            others = [what for what in in_order if what != "slow"]
            return (others[0], False) if others else (CONTINUE, self.struck and not self.stopped)
        for what in in_order:
            if self.right(what):
                return what, True
        return next((what for what in in_order if what != "slow"), ""), False

    def outcome(self) -> str:
        """One of avoided, harm, stopped, unaffected, missed."""
        if self.peak_stray_mm >= self.harm.stray_mm or self.driven_mm >= self.harm.depth_mm:
            return "harm"
        if self.answer()[1]:
            return "avoided"
        if self.stopped:
            return "stopped"
        if self.peak_stray_mm < AFFECTED_MM and self.cue_ms is None:
            return "unaffected"
        return "missed"

    def score(self) -> float | None:
        """0 to 100, None where there was nothing to be done and nothing was."""
        if self.outcome() == "unaffected":
            return None
        what, ok = self.answer()
        response = 0.0
        if ok:
            limit = max(self.hazard.within_s * 1000.0 - FASTEST_MS, 1.0)
            late = 0.0 if what == CONTINUE else max(self.reaction_ms(what) - FASTEST_MS, 0.0)
            response = 1.0 - 0.5 * min(late / limit, 1.0)
        used = max(self.peak_stray_mm / self.harm.stray_mm, self.driven_mm / self.harm.depth_mm)
        return round(50.0 * response + 50.0 * max(0.0, 1.0 - used), 1)

    def row(self) -> dict[str, Any]:
        """Its columns of hazards.csv."""
        what, ok = self.answer()
        answered = what in self.responses
        return {
            "cue": "on" if self.cue_on else "off",
            "number": self.hazard.number,
            "hazard": self.hazard.hazard,
            "title": self.hazard.title,
            "arm": self.arm,
            "armed_ms": self.armed_ms,
            "struck_ms": self.struck_ms,
            "knowable_ms": self.knowable_ms,
            "knowable_by": self.knowable_by or None,
            "cue_ms": self.cue_ms,
            "alarm_ms": self.alarm_ms,
            "alarm": self.alarm or None,
            "response": what or None,
            "response_ms": self.responses[what] if answered else None,
            "reaction_ms": self.reaction_ms(what) if answered else None,
            "right_response": " ".join(self.hazard.right_response),
            "response_ok": ok,
            "peak_error_mm": round(self.peak_error_mm, 4) if self.struck else None,
            "peak_stray_mm": round(self.peak_stray_mm, 4) if self.struck else None,
            "deepest_mm": round(self.deepest_mm, 4) if math.isfinite(self.deepest_mm) else None,
            "stopped": self.stopped,
            "outcome": self.outcome(),
            "score": self.score(),
        }

    def _originate(self, tick: int) -> None:
        if self.origin_ms is None or tick < self.origin_ms:
            self.origin_ms = tick
