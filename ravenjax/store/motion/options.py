"""Defines the keys of [operator] in a campaign file that describe a recording of an operator's
hands."""

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
"""Longest gap that can be bridged, s. A longer one is a clock that was set."""
MAX_GAP_S = 0.1
"""Default of the longest gap between two samples, s. Hands move some millimetres in it."""


@dataclasses.dataclass(frozen=True)
class ReplayOptions:
    """Each option changes the recording in one way; the defaults change nothing."""

    # Names of a table's columns: in order, of a table without a header line; or the file's name by
    # ravenjax's; "jigsaws": those of JIGSAWS' kinematics.
    columns: Columns = dataclasses.field(default_factory=list)
    # Topic or namespace of each arm in a bag.
    topics: dict[str, str] = dataclasses.field(default_factory=dict)
    # The column that names each row's sensor, as "column", and each arm's sensor.
    sensors: dict[str, str | int] = dataclasses.field(default_factory=dict)
    # Frame of the positions; None: as the headers of a bag name it, else frame 0.
    frame: Frame | None = None
    # Turn (rows of a matrix, or x, y, z, w) and then offset, after `frame`; or those of each arm.
    rotation: Turn | dict[str, Turn] | None = None
    offset_mm: Triple | dict[str, Triple] | None = None
    # "home": moved and turned so that the replayed part begins at the pose after homing.
    place: Place = "recorded"

    rate_hz: float | None = None  # rows per second, evenly spaced; None: by the file's time stamps
    # Part that is replayed, s; None: from the first row on.
    window_s: tuple[float, float] | None = None
    cutoff_hz: float | None = None  # of the low-pass; None: no filter
    slow_down: float = 1.0  # how much slower than recorded it is replayed
    # Longer gaps between samples are refused in the replayed part.
    max_gap_s: float = MAX_GAP_S
    # What happens at tips that jump.
    spikes: Spikes = "refuse"
    # Profile of a stream of packets, as `store.consoles.loading.profile_choices` takes it.
    console: str = "auto"
    # What happens if the recording ends before the run.
    at_end: AtEnd = "refuse"

    # Options may hold tables, which have no hash.
    def __hash__(self) -> int:
        return hash(repr(self))

    def written(self, key: str, value: object) -> str:
        """Return how a user writes an option."""
        return f"operator.{key} = {value}"


def of_arm(value: Any, arm: str) -> Any:
    """Return an option that is one for all arms, or a table of those of each."""
    return value.get(arm) if isinstance(value, dict) else value
