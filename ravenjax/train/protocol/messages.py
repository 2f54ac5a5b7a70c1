"""Defines the commands to a session and its events: plain dicts, sent as JSON.

Commands come from consoles and instructors. They reach the session at any rate through a ring in
shared memory, one JSON object each. The session takes those that have arrived at the beginning of a
tick, so it depends only on a list of (tick, command).

    {"type": "input", "source": "keyboard", "pedal": true,
     "arms": {"gold": {"move": [x, y, z], "turn": [x, y, z], "grasp": g}}}

The operator's hands now. The input holds until the next one, and is stale after `STALE_MS` without
any. `move` and `turn` are speeds along and about the axes of the *view* (`VIEW`), cut to length 1.
`grasp` -1 opens, 1 closes. An arm that is left out stays still.

    {"type": "increments", "source": "itp", "pedal": true,
     "arms": {"gold": {"delta_um": [x, y, z], "quat": [x, y, z, w], "grasp_mrad": g}}}

Increments of a console since its last message, in the ITP frame, scaled as the robot takes them.
They are applied once, and stale after `STALE_MS`.

    {"type": "operator", "do": DO, "by": ROLE}

DO: estop, restart, rehearse, reengage, discard, note (with "text"). `by` is "instructor" or
"watcher" if a window of that role sends it. Such a command never counts as the operator's response.

    {"type": "instructor", "do": DO}

DO: start (the session's time), arm (with "hazard", its number), disarm, pause, resume, reset, end,
cue (with "on"). "end" from the terminal has "by": "terminal". After the session, next (with
"participant", "scenario", "seed", all optional) requests another one in its place.

    {"type": "seat", "do": DO, "by": ROLE}

Who drives, see `session.console_arbiter`. DO: take (for the sending console), give (with "to", one
of `CONSOLES`), left (the sending console is gone).

    {"type": "unheard", "why": WHY}

The packet filter refuses everything from a network console; "": it accepts it again. With "once":
true, one message was not followed.

"input", "increments", "seat" and "unheard" have a "console", one of `CONSOLES` except the first.
The channel through which they come adds it. Messages without it are a script's.

Events have "tick" (ms since the session began, without pauses) and "kind":

- phase (phase), view (view), console (alive, source), pedal (down), runlevel (runlevel).
- owner (console, by): who drives now, by "pedal", "operator", "instructor", "left" or "silent".
- refused (console, why): a console may not drive, or its pedal does not count; "": it counts again.
- rearm (why): the pedal must be lifted before it drives again.
- started (by): the session's time runs, by "pedal" or "instructor".
- alarm (check, count): a check raised an alarm or stopped the robot; with "virtual": true, the
  virtual one during a trial.
- alarm_count (check, count): it keeps tripping.
- hazard_armed (number, row: the columns of hazards.csv known by then), hazard_struck (number).
- knowable (number, by, ms), cue (number or -1, arm).
- stopped, flagged, limited (number, check, ms): first check with this kind of response.
- unintended_motion, loss_of_motion, false_report (number, arm, mm): over the limit for the first
  time; loss_of_motion (number, halted_ms): out of pedal-down for too long.
- response (number, what, ok, ms), interrupted (number, by): others cut the hazard off.
- hazard_over (number, check_response, motion_hazard, halted, outcome, score).
- hazard_row (row): the row of hazards.csv, for a recording that is cut short.
- level (level, of, title, within_s, in_a_row, needs, took_ms, within): the operator's level, from
  1, its requirements, and the time of the last round, null before the first.
- target (target), object (held, at), task_done, note (text), overrun (late_ticks), trouble (text).
- end (reason): "time", "task", "instructor" or "interrupted" (at the terminal).

`number` is that of the hazard in session.json. In "cue" it is -1 if no hazard is active or the
golden run has had the cue, too. `ravenjax.outcomes` defines the terms for checks and motion.
"""

import json
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ravenjax.train.robot import ArmName, Quat, unit_quaternion
from ravenjax.vocabulary.packets import QUIET_MS

Json = dict[str, Any]
"""A JSON object."""
Command = dict[str, Any]
"""A command, as above."""
Event = dict[str, Any]
"""An event, as above."""
Say = Callable[[str], None]
"""Prints a line for the user."""
STALE_MS = QUIET_MS
"""Older input counts as no input: pedal up, hands at rest, no force."""
VIEW = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""Right, up and toward the operator in the world (z up, gold arm at negative x)."""
encode = json.JSONEncoder(separators=(",", ":")).encode
"""Returns a command or an event as JSON text."""
OPERATOR = ("estop", "restart", "rehearse", "reengage", "discard", "note")
INSTRUCTOR = ("start", "arm", "disarm", "pause", "resume", "reset", "end", "cue")
SEAT = ("take", "give", "left")


def _unit(quat: list[float]) -> Quat:
    try:
        return unit_quaternion(quat)
    except ZeroDivisionError:
        raise ValueError("expected a quaternion of length 1, not 0") from None


# The limit of 1e9 keeps whole numbers exact and squares finite.
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Turn = Annotated[list[Number], Field(min_length=4, max_length=4), AfterValidator(_unit)]


class Message(BaseModel):
    """A message, or a table in it. Unknown keys are an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Hand(Message):
    """Speeds of one hand, as shares of the greatest."""

    move: Vector = [0.0, 0.0, 0.0]
    turn: Vector = [0.0, 0.0, 0.0]
    grasp: Number = 0.0


class Increment(Message):
    """The motion of one hand since a console's last message."""

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
