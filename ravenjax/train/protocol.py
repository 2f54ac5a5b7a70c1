"""Defines the data that the processes of a training session exchange, and the scene's geometry.

A *frame* is one millisecond of a session as a row of named float32 numbers, for the page, the
recording and `train.judge`, which scores the operator. `channels.toml` lists the names. Whole
numbers stay below 2^24, because float32 is exact up to there. A session therefore lasts at most 4.5
hours. Lengths are in m and angles in rad unless a name's suffix gives another unit. `tip`,
`position` and `force` are in coordinates of the arm's frame 0. *Commands* and *events* are plain
dicts, sent as JSON (docs/how-to/training-messages.md). At the beginning of each tick the session
reads the commands that have arrived. The same commands in the same ticks give the same session. The
*scene* is the geometry for code that runs every millisecond. Its tip is the point where the jaws
close, which people see as the tip. The control software's tip is the jaws' axis.
"""

import json
import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import accumulate
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ravenjax import resources
from ravenjax.train import robot
from ravenjax.train.robot import JAW_LENGTH, ArmName, Arms, scene
from ravenjax.vocabulary.packets import QUIET_MS

CHANNELS: dict[str, dict[str, int]] = resources.read_tables(__file__, "channels.toml")
"""Channels of the robot's tick (`simulated`) and of the session: the number of values of each."""
GOLDEN = ("golden_halted_ms", "golden_cue")
"""Channels of the golden run. They are neighbours in a row."""
_SHARED = resources.read_tables(__file__, "protocol.toml")
PHASES: list[str] = _SHARED["phases"]
CONSOLES: list[str] = _SHARED["consoles"]
VIEWS: list[str] = _SHARED["views"]
"""Names of the phases of a session, of the consoles that may drive, and of the views."""
READY, RUNNING, PAUSED, STOPPED, OVER, LOST = range(len(PHASES))
REAL, VIRTUAL, REPLAY = range(len(VIEWS))
Point = tuple[float, float, float]
Rows = tuple[Point, Point, Point]
Json = dict[str, Any]
"""A JSON object."""
Command = dict[str, Any]  # A command, as the module's docstring defines it
Event = dict[str, Any]  # An event, as the module's docstring defines it
Say = Callable[[str], None]  # Prints a line for the user
STALE_MS = QUIET_MS
"""Input older than this, ms, counts as no input: pedal up, hands at rest, no force."""
VIEW: Rows = _SHARED["operator_axes"]
"""Axes of the operator's view (right, up, toward) in the world: z up, gold arm at negative x."""
encode = json.JSONEncoder(separators=(",", ":")).encode
"""Returns a command or an event as JSON text."""
# Up to this limit, whole numbers are exact and squares are finite.
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
TISSUE = {"top": scene.TISSUE_TOP, "sag": scene.TISSUE_SAG, "half": scene.TISSUE_HALF}
"""Shape of the tissue's dome, m, for the page that draws it."""
_DRAWN = _SHARED["drawn"]


class FrameLayout:
    """The position of each channel in a row of a frame."""

    def __init__(self, arms: Arms, sizes: dict[str, int]):
        """sizes: the number of values of each channel, in their order."""
        self.arms, self.sizes = arms, sizes
        # Each channel ends where the next begins.
        ends = [0, *accumulate(sizes.values())]
        self.places = dict(zip(sizes, map(slice, ends, ends[1:]), strict=False))
        self.size = ends[-1]

    @staticmethod
    def of(arms: Arms) -> "FrameLayout":
        """Return the layout for these arms: the tick's channels first, the session's after them."""
        sizes = {}
        for source in ("simulated", "session"):
            sizes |= CHANNELS[source]
            for arm in arms:
                for name, size in CHANNELS[f"{source}_arm"].items():
                    sizes[f"{arm}/{name}"] = size
        return FrameLayout(arms, sizes)

    def of_channels(self, is_kept: Callable[[str], bool]) -> "FrameLayout":
        """Return the layout of a row that has only the channels that `is_kept` selects."""
        sizes = {name: size for name, size in self.sizes.items() if is_kept(name)}
        return FrameLayout(self.arms, sizes)

    @property
    def simulated(self) -> int:
        """The number of values that the robot's tick fills. They come first in a row."""
        return self.places["session_tick"].start

    def names(self) -> list[str]:
        """Return a name for each number of a row: `gold/jpos/0`, or `runlevel` if single."""
        return [
            name if size == 1 else f"{name}/{i}"
            for name, size in self.sizes.items()
            for i in range(size)
        ]


class Frame:
    """A row, read by name: `frame["gold/tip"]` is an array, `frame.number("runlevel")` a number.
    `numbers` contains the row as Python floats, because reading many single numbers of an array is
    slow. Writing by name changes both. After writing into `row` directly, call `copy_numbers()`.
    """

    __slots__ = ("layout", "numbers", "row")

    def __init__(self, layout: "FrameLayout", row: np.ndarray | None = None):
        """row: float32 [layout.size]; zeros if left out."""
        self.layout = layout
        self.row = np.zeros(layout.size, np.float32) if row is None else row
        self.numbers: list[float] = []
        self.copy_numbers()

    def copy_numbers(self) -> None:
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


Turn = Annotated[
    list[Number], Field(min_length=4, max_length=4), AfterValidator(robot.unit_quaternion)
]


class Message(BaseModel):
    """Base of messages and of the tables in them. Unknown keys are an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Hand(Message):
    """Speeds of one hand, as shares of the greatest speed."""

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
    """The motion of a network console's hands since its last message."""

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
    rotation, axes = np.array(frame0_in_world(arm)[1]), np.array(_rows(robot.ITP_AXES[arm]))
    return _rows(axes.T @ rotation.T @ np.array(VIEW).T)


def tissue_height(x: float, y: float) -> float:
    """Return the height of the tissue's dome at (x, y), m. The dome continues beyond its edge."""
    return scene.TISSUE_TOP - scene.TISSUE_SAG[0] * x * x - scene.TISSUE_SAG[1] * y * y


def turn_vector(rows: Rows, v: Point) -> Point:
    """Return the product of the matrix `rows` and the vector `v`."""
    x, y, z = v
    first, second, third = (a * x + b * y + c * z for a, b, c in rows)
    return first, second, third


def _rows(matrix) -> Any:
    return tuple(tuple(float(number) for number in row) for row in matrix)


def closing_point(arm: ArmName, axis: Sequence[float], jpos: Sequence[float]) -> Point:
    """Return where the jaws close, m, frame 0. axis: position of their axis. jpos: [7], rad, m."""
    x, y, z = jaw_direction(arm, jpos)
    return axis[0] + JAW_LENGTH * x, axis[1] + JAW_LENGTH * y, axis[2] + JAW_LENGTH * z


def tip_in_world(frame: Frame, arm: ArmName) -> Point:
    """Return where the jaws of the robot meet in a frame, m, world."""
    axis, jpos = frame[f"{arm}/tip"].tolist(), frame[f"{arm}/link_jpos"].tolist()
    return to_world(arm, closing_point(arm, axis, jpos))


def jaw_direction(arm: ArmName, jpos: Sequence[float]) -> Point:
    """Return the unit vector along the closed jaws in frame 0, at joints [7] in rad and m."""
    geometry = robot.GEOMETRY[arm]
    right = math.pi / 2
    x, y, z = 1.0, 0.0, 0.0
    # From the jaws back to frame 0. Each row: a joint's angle about z, then sine and cosine of the
    # link's twist about x. The insertion does not turn, so there is no row for it.
    for theta, sine, cosine in (
        (0.5 * (jpos[6] - jpos[5]), 1.0, 0.0),
        (jpos[4] - right, 1.0, 0.0),
        (jpos[3] + geometry.side * right, robot.GM3, geometry.cos23),
        (jpos[1] + geometry.zero2, robot.GM1, robot.GM2),
        (jpos[0] + geometry.zero1, 0.0, geometry.flip),
    ):
        s, c = math.sin(theta), math.cos(theta)
        x, y = c * x - s * y, s * x + c * y
        y, z = cosine * y - sine * z, sine * y + cosine * z
    return x, y, z


def with_tips(layout: "FrameLayout", row: np.ndarray) -> np.ndarray:
    """Return a copy of a frame's row for drawing: its tips are the points where the jaws close."""
    frame = Frame(layout, row.copy())
    for arm in layout.arms:
        # `_DRAWN` maps each channel of a tip to the channel of its joints.
        for tip, joints in _DRAWN.items():
            on_axis, jpos = frame[f"{arm}/{tip}"].tolist(), frame[f"{arm}/{joints}"].tolist()
            frame[f"{arm}/{tip}"] = closing_point(arm, on_axis, jpos)
    return frame.row
