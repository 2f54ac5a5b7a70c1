"""Defines what a session's parts exchange: frames, commands, events, and the scene in numbers.

**Frames.** A frame is one millisecond of a session as a row of named float32 numbers. The page, the
recording and the judge read frames. `channels.toml` lists the names. Whole numbers stay below 2^24,
which float32 holds exactly: four and a half hours of ticks. Lengths are m and angles rad unless a
suffix says otherwise. `tip`, `position` and `force` are in the arm's frame 0.

The golden run restarts from the robot's state whenever a hazard is armed.

**The scene** is in plain numbers, for code that runs every millisecond. It has the arms' frames,
the axes of consoles, and the tissue, as in `geometry.scene` and `geometry.mapping`. It also has
where the jaws close, which a person takes for the tip of an instrument. The software's tip is the
axis of the jaws.

**Commands and events** are plain dicts, sent as JSON. Commands come from consoles and instructors.
They reach the session at any rate through a ring in shared memory, one JSON object each. The
session takes those that have arrived at the beginning of a tick, so it depends only on a list of
(tick, command).

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

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ravenjax.train.robot import (
    GEOMETRY,
    GM1,
    GM2,
    GM3,
    ITP_AXES,
    JAW_LENGTH,
    ArmName,
    Arms,
    Quat,
    scene,
    unit_quaternion,
)
from ravenjax.vocabulary.packets import QUIET_MS

CHANNELS: dict[str, dict[str, int]] = tomllib.loads(
    Path(__file__).with_name("channels.toml").read_text(encoding="utf-8")
)
"""Channels of the tick (`simulated`) and of the session, with the number of values of each."""
GOLDEN = ("golden_halted_ms", "golden_cue")
"""Channels of the golden run. They are neighbours in a row."""


PHASES = ("ready", "running", "paused", "stopped", "over", "lost")
"""Phases of a session.

ready: waiting for the first pedal-down; running; paused by the instructor; stopped: the robot's
E-stop; over; lost: no reports arrive, and the robot's state is unknown.
"""
READY, RUNNING, PAUSED, STOPPED, OVER, LOST = range(len(PHASES))
CONSOLES = ("nobody", "page", "itp", "script", "crtk")
"""What may drive: nobody, the operator's page, ITP or CRTK over the network, or a script."""
VIEWS = ("real", "virtual", "replay")
"""What follows the hand.

real: the robot; virtual: only the virtual robot, while the robot rests; replay: the robot, which
repeats the tried motion.
"""
REAL, VIRTUAL, REPLAY = range(len(VIEWS))
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
# The limit of 1e9 keeps whole numbers exact and squares finite.
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
TISSUE = {"top": scene.TISSUE_TOP, "sag": scene.TISSUE_SAG, "half": scene.TISSUE_HALF}
"""The tissue's dome for a window that draws it, m."""
Point = tuple[float, float, float]
Rows = tuple[Point, Point, Point]
_DRAWN = {"tip": "link_jpos", "virtual_tip": "virtual_jpos", "model_tip": "model_jpos"}
"""Channels of the jaws' axis, each with the channel of its joints."""


@dataclasses.dataclass(frozen=True)
class FrameLayout:
    """The place of each channel in a row."""

    arms: Arms
    places: dict[str, slice]
    size: int

    @staticmethod
    def of(arms: Sequence[ArmName]) -> FrameLayout:
        """Return the layout for these arms: the tick's channels first, the session's after them."""
        places: dict[str, slice] = {}
        at = 0
        for source in ("simulated", "session"):
            each = CHANNELS[f"{source}_arm"].items()
            named = CHANNELS[source] | {
                f"{arm}/{name}": size for arm in arms for name, size in each
            }
            for name, size in named.items():
                places[name] = slice(at, at + size)
                at += size
        return FrameLayout(tuple(arms), places, at)

    def of_channels(self, keeps: Callable[[str], bool]) -> FrameLayout:
        """Return the layout of a row that has only some channels, in the same order."""
        places: dict[str, slice] = {}
        size = 0
        for name, place in self.places.items():
            if keeps(name):
                places[name] = slice(size, size + place.stop - place.start)
                size = places[name].stop
        return FrameLayout(self.arms, places, size)

    @property
    def simulated(self) -> int:
        """The number of values that the tick fills."""
        return self.places["session_tick"].start

    def names(self) -> list[str]:
        """Return a name for each number: `gold/jpos/0`, or `runlevel` for a single one."""
        return [
            name if place.stop - place.start == 1 else f"{name}/{i}"
            for name, place in self.places.items()
            for i in range(place.stop - place.start)
        ]


class Frame:
    """A row, read by names: `frame["gold/tip"]` is an array, `frame.number("runlevel")` a number.

    `numbers` is the same row as Python floats, for readers of many single numbers. Writing by name
    changes both. After filling the row directly, call `settle()`.
    """

    __slots__ = ("layout", "numbers", "row")

    def __init__(self, layout: FrameLayout, row: np.ndarray | None = None) -> None:
        """row: float32 [layout.size]; zeros if left out."""
        self.layout = layout
        self.row = np.zeros(layout.size, np.float32) if row is None else row
        self.numbers: list[float] = []
        self.settle()

    def settle(self) -> None:
        """Copy the row into `numbers`."""
        self.numbers = self.row.tolist()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.row[self.layout.places[name]]

    def __setitem__(self, name: str, value: Any) -> None:
        place = self.layout.places[name]
        self.row[place] = value
        self.numbers[place] = self.row[place].tolist()

    def number(self, name: str) -> float:
        """Return the value of a channel with a single number."""
        return float(self.row[self.layout.places[name].start])


def _unit(quat: list[float]) -> Quat:
    try:
        return unit_quaternion(quat)
    except ZeroDivisionError:
        raise ValueError("expected a quaternion of length 1, not 0") from None


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


@cache
def frame0_in_world(arm: ArmName) -> tuple[Point, Rows]:
    """Return origin (m) and rotation rows of the arm's frame 0 in the world."""
    origin, rotation = scene.frame0_in_world(arm)
    rows = _rows([origin, *rotation])
    return rows[0], rows[1:]


def to_world(arm: ArmName, position: Point) -> Point:
    """Return a point of the arm's frame 0 in the world, m."""
    (ox, oy, oz), rows = frame0_in_world(arm)
    x, y, z = turn_vector(rows, position)
    return ox + x, oy + y, oz + z


@cache
def itp_from_view(arm: ArmName) -> Rows:
    """Return rotation rows from the axes of the operator's view to those of ITP packets."""
    rotation, axes = np.array(frame0_in_world(arm)[1]), np.array(_rows(ITP_AXES[arm]))
    return _rows(axes.T @ rotation.T @ np.array(VIEW).T)


def view_from_world(way: Point) -> Point:
    """Return a displacement in the world along the axes of the operator's view."""
    return turn_vector(VIEW, way)


def tissue_height(x: float, y: float) -> float:
    """Return the height of the tissue's dome at (x, y), m, also beside the tissue."""
    return scene.TISSUE_TOP - scene.TISSUE_SAG[0] * x * x - scene.TISSUE_SAG[1] * y * y


def turn_vector(rows: Rows, v: Point) -> Point:
    """Return `rows` times `v`."""
    x, y, z = v
    a, b, c = rows
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


def _rows(matrix: Any) -> Any:
    return tuple(tuple(float(number) for number in row) for row in matrix)


def closing_point(arm: ArmName, axis: Sequence[float], jpos: Sequence[float]) -> Point:
    """Return where the ends of the jaws meet, m. axis: their axis, m, frame 0. jpos: [7]."""
    x, y, z = jaw_direction(arm, jpos)
    return axis[0] + JAW_LENGTH * x, axis[1] + JAW_LENGTH * y, axis[2] + JAW_LENGTH * z


def jaw_tips(arm: ArmName, closing: Sequence[float], jpos: Sequence[float]) -> tuple[Point, Point]:
    """Return the ends of both jaws, m, frame 0. closing: where they close. jpos: joints [7]."""
    middle = jaw_direction(arm, jpos)
    out = []
    for angle in (-jpos[5], jpos[6]):
        way = jaw_direction(arm, (*jpos[:5], -angle, angle))
        out.append(
            tuple(c + JAW_LENGTH * (a - b) for c, a, b in zip(closing, way, middle, strict=True))
        )
    return out[0], out[1]


def jaw_direction(arm: ArmName, jpos: Sequence[float]) -> Point:
    """Return the unit vector along the closed jaws in frame 0, at joints [7] in rad and m."""
    geometry = GEOMETRY[arm]
    cos23, side, flip = geometry.cos23, geometry.side, geometry.flip
    theta1, theta2 = jpos[0] + geometry.zero1, jpos[1] + geometry.zero2
    s2, c2 = math.sin(theta2), math.cos(theta2)
    roll, bend, yaw = jpos[3], jpos[4], 0.5 * (jpos[6] - jpos[5])
    # Axes of frame 3 in frame 1, then those of frames 4 to 6. theta5 is the wrist minus a quarter
    # turn.
    x3 = (
        -side * cos23 * s2,
        side * (GM2 * cos23 * c2 - GM1 * GM3),
        side * (GM1 * cos23 * c2 + GM2 * GM3),
    )
    y3 = (-side * c2, -side * GM2 * s2, -side * GM1 * s2)
    z3 = (GM3 * s2, -GM2 * GM3 * c2 - GM1 * cos23, -GM1 * GM3 * c2 + GM2 * cos23)
    s4, c4 = math.sin(roll), math.cos(roll)
    s5, c5 = -math.cos(bend), math.sin(bend)
    s6, c6 = math.sin(yaw), math.cos(yaw)
    by_x, by_y = c4 * c5 * c6 + s4 * s6, s4 * c5 * c6 - c4 * s6
    x, y, z = (by_x * a + by_y * b + s5 * c6 * c for a, b, c in zip(x3, y3, z3, strict=True))
    s1, c1 = math.sin(theta1), math.cos(theta1)
    return c1 * x - s1 * y, flip * (s1 * x + c1 * y), flip * z


def with_tips(layout: FrameLayout, row: np.ndarray) -> np.ndarray:
    """Return a copy of a frame's row, with tips where the jaws close, for drawing."""
    frame = Frame(layout, row.copy())
    for arm in layout.arms:
        for axis, joints in _DRAWN.items():
            place = f"{arm}/{axis}"
            frame[place] = closing_point(
                arm, frame[place].tolist(), frame[f"{arm}/{joints}"].tolist()
            )
    return frame.row
