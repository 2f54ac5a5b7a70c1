"""Defines the keys of [operator] in a campaign file that describe a recording of hands."""

import dataclasses
from typing import Any, Literal

Spikes = Literal["refuse", "remove", "replay"]
AtEnd = Literal["refuse", "hold", "reverse"]
Frame = Literal["frame0", "arm_base", "console"]
"""Frames of an arm: frame 0 of its kinematics, CRTK's base frame of raven2, axes of the console."""
Place = Literal["recorded", "home"]
Columns = Literal["jigsaws"] | list[str] | dict[str, str]
Triple = tuple[float, float, float]
Turn = tuple[Triple, Triple, Triple] | tuple[float, float, float, float]

MOST_GAP_S = 60.0
"""Longest gap between two samples, s. In a longer gap the recorder's clock was set."""
MAX_GAP_S = 0.1
"""Default of the longest gap between two samples, s. Hands move some millimetres in 0.1 s."""


@dataclasses.dataclass(frozen=True)
class ReplayOptions:
    """Options for replaying a recorded motion; the defaults do not change the motion."""

    # Names of a table's columns. A list names the columns of a table without a header line, in
    # order. A dictionary gives the file's name for each of ravenjax's names. "jigsaws" means the
    # columns of the data set JIGSAWS.
    columns: Columns = dataclasses.field(default_factory=list)
    # Topic or namespace of each arm in a bag.
    topics: dict[str, str] = dataclasses.field(default_factory=dict)
    # For a table with the samples of all sensors in one column: "column" gives the column that
    # names each row's sensor, and each arm gives the name of its sensor.
    sensors: dict[str, str | int] = dataclasses.field(default_factory=dict)
    # Frame of the positions; None: the frame in the headers of a bag; for other files frame 0.
    frame: Frame | None = None
    # Rotation (matrix or quaternion x, y, z, w), then offset. Both are applied after the conversion
    # from `frame` to frame 0, for all arms or separately for each arm.
    rotation: Turn | dict[str, Turn] | None = None
    offset_mm: Triple | dict[str, Triple] | None = None
    # "home": moved and turned so that the replayed part begins at the pose after homing.
    place: Place = "recorded"

    rate_hz: float | None = None  # rows per second, evenly spaced; None: use the file's time stamps
    # Begin and end of the replayed part, s; None: the whole recording.
    window_s: tuple[float, float] | None = None
    cutoff_hz: float | None = None  # cutoff of the low-pass filter; None: no filter
    slow_down: float = 1.0  # duration of the replayed motion relative to the recorded one
    # Longest permitted gap between two samples in the replayed part, s.
    max_gap_s: float = MAX_GAP_S
    spikes: Spikes = "refuse"  # treatment of implausible jumps of a tip
    console: str = "auto"  # console profile of a packet stream: "auto", a name or a file
    at_end: AtEnd = "refuse"  # what the hands do if the recording is shorter than the run

    # Dictionaries among the options cannot be hashed, but their text can.
    def __hash__(self) -> int:
        return hash(repr(self))

    def written(self, key: str, value: object) -> str:
        """Return an option with a value as a user writes it in a campaign file."""
        return f"operator.{key} = {value}"


def of_arm(value: Any, arm: str) -> Any:
    """Return the value of an option for one arm. value: one value for all arms, or one per arm."""
    return value.get(arm) if isinstance(value, dict) else value
