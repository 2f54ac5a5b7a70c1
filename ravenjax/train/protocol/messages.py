"""Commands of consoles and instructors to a session, and the events of a session: plain dicts, JSON
on the way.

Commands reach the session through a ring in shared memory, one JSON object each, at any rate; the
session takes what is there at the beginning of a tick, so that a list of (tick, command) is all
that a session depends on.

    {"type": "input", "source": "keyboard", "pedal": true,
     "arms": {"gold": {"move": [x, y, z], "turn": [x, y, z], "grasp": g}}}
        the operator's hands now; it holds until the next one, and is stale after `STALE_MS` without any. `move` and
        `turn` are speeds along and about the axes of the *view* (`VIEW`), cut to length 1; `grasp` -1 opens, 1 closes.
        An arm that is left out stays still.
    {"type": "increments", "source": "itp", "pedal": true,
     "arms": {"gold": {"delta_um": [x, y, z], "quat": [x, y, z, w], "grasp_mrad": g}}}
        increments of a console since its last message, ITP frame, as the robot would take them (the console has scaled
        them); applied once. They too are stale after `STALE_MS`.
    {"type": "operator", "do": DO, "by": ROLE}
        DO: estop, restart, rehearse, reengage, discard, note (with "text"). `by` is there where a window of another
        role says so, "instructor" or "watcher": it is done, and never counts as the operator's response.
    {"type": "instructor", "do": DO}, "end" with "by": "terminal" where it comes from there
        DO: start (the session's time), arm (with "hazard": its number in the session's list), disarm, pause, resume,
        reset, end, cue (with "on"). Once the session is over its starter looks for next (with "participant",
        "scenario", "seed", each of which may be left out): another session takes this one's place
    {"type": "seat", "do": DO, "by": ROLE}
        who drives, see `session.console_arbiter`. DO: take (for the console that says so), give (with "to", one of `CONSOLES`),
        left (the console that says so is gone)
    {"type": "unheard", "why": WHY}
        nothing of a console over the network is taken, as the packet filter refuses it; "": it is again. With "once":
        true something was not followed once

"input", "increments", "seat" and "unheard" have a "console", one of `CONSOLES` but the first, which
the channel stamps that they come through; where it is missing they are a script's.

Events of a session have "tick" (ms since the session began, pauses left out) and "kind":

    phase (phase), view (view), console (alive, source), pedal (down), runlevel (runlevel),
    owner (console, by): who drives from now on, and how that came: "pedal", "operator", "instructor", "left", "silent"
    refused (console, why): who wanted to drive and may not now; of a console over the network also why its pedal does
        not count (`session.pedal`), "" once that is over
    rearm (why): the pedal must be seen up before it drives again
    started (by): the session's time runs from now on, "pedal" or "instructor"
    alarm (check, count): a check told a person or stopped the robot; alarm_count (check, count): it goes on doing so
    hazard_armed (number, row: the columns of hazards.csv that are known by then), hazard_struck (number), knowable (number, by, ms), cue (number or -1, arm),
    stopped, flagged, limited (number, check, ms): first check of this kind of response to the hazard
    unintended_motion, loss_of_motion, false_report (number, arm, mm): over the scenario's limit for the first time;
        loss_of_motion (number, halted_ms): out of pedal-down for too long
    response (number, what, ok, ms): of the operator
    interrupted (number, by): the hazard was cut off by what is not the operator's, and is not scored
    hazard_over (number, check_response, motion_hazard, halted, outcome, score)
    hazard_row (row): the hazard's row of hazards.csv, for a recording that is cut short
    level (level, of, title, within_s, in_a_row, needs, took_ms, within): which level the operator is at, from 1, what
        it asks, and how long the round before took, null before the first of all
    target (target), object (held, at), task_done, note (text), overrun (late_ticks), trouble (text),
    end (reason): "time", "task", "instructor", "interrupted" (at the terminal)

`number` counts the hazards of the session's list (`session.json`, "hazards"); in "cue" it is -1
where no hazard is at work or the golden run has had the cue, too. Words of checks and motion:
`ravenjax.outcomes`.
"""  # noqa: E501

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ravenjax.train.robot import ArmName, unit
from ravenjax.vocabulary.packets import QUIET_MS

STALE_MS = QUIET_MS
"""Input that is older counts as none: pedal up, hands at rest, no force."""
VIEW = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""Axes of the operator's view in the world (z up, gold arm at negative x): right, up, toward the
operator.
"""
OPERATOR = ("estop", "restart", "rehearse", "reengage", "discard", "note")
INSTRUCTOR = ("start", "arm", "disarm", "pause", "resume", "reset", "end", "cue")
SEAT = ("take", "give", "left")

# 1e9 keeps whole numbers exact and squares finite.
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Turn = Annotated[list[Number], Field(min_length=4, max_length=4), AfterValidator(unit)]


class Message(BaseModel):
    """A message, or a table in it: keys that are unknown are an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Hand(Message):
    """Speeds of one hand, shares of the greatest."""

    move: Vector = [0.0, 0.0, 0.0]
    turn: Vector = [0.0, 0.0, 0.0]
    grasp: Number = 0.0


class Increment(Message):
    """What a console has moved one hand by."""

    delta_um: Vector
    quat: Turn | None = None
    grasp_mrad: Number = 0.0


class Input(Message, extra="ignore"):
    """The operator's hands and pedal."""

    type: Literal["input"]
    source: Annotated[str, Field(max_length=16)] = ""
    pedal: bool
    arms: dict[ArmName, Hand]


class Increments(Message, extra="ignore"):
    """Increments of a console."""

    type: Literal["increments"]
    pedal: bool
    arms: dict[ArmName, Increment]
