"""Defines the fault sites of a robot: signals with channels into which faults are injected.

A robot declares its sites in its own order. A signal is a record of numbers, and the path of a
channel leads to one of these numbers. `ARM` in a path stands for an index in `setup.arms`.
"""

import dataclasses
from typing import Literal, NamedTuple

ARM = "ARM"
PARAMETER = "parameter"
"""Fault site whose channels are parameters of the robot, named by their paths."""
Kind = Literal["int16", "int24", "int32", "float", "bool"]
"""Type of a number. An int24, such as an encoder count, is stored as int32 and does not wrap."""


@dataclasses.dataclass(frozen=True)
class Field:
    """The range of a number that has fewer values than its type. Both ends are included."""

    low: float
    high: float
    noun: str  # name of the type in messages
    bits: int


BITS: dict[Kind, int] = {"int16": 16, "int24": 24, "int32": 32, "float": 32, "bool": 1}


@dataclasses.dataclass(frozen=True)
class Channel:
    """One number of a site's signal."""

    name: str
    path: tuple[str | int, ...]  # attributes and indices from the site's signal to the number
    kind: Kind
    unit: str
    field: Field | None = None  # None: any value of its type
    # Its constant value without a fault, or a parameter's path with this value; None: it varies.
    usual: float | str | None = None
    pedal: tuple[float, ...] = ()  # its constant values while the pedal is up, and while it is down

    @property
    def bits(self) -> int:
        """Width of the number in bits."""
        return BITS[self.kind] if self.field is None else self.field.bits

    @property
    def extent(self) -> tuple[float | None, float | None]:
        """Smallest and largest number of the channel's field or type; None, None for a float."""
        if self.field is not None:
            return self.field.low, self.field.high
        if self.kind == "float":
            return None, None
        if self.kind == "bool":
            return 0, 1
        half = 2 ** (self.bits - 1)
        return -half, half - 1


class ChannelRange(NamedTuple):
    """Normal range of one channel: its values without a fault, in the channel's unit."""

    site: str
    arm: str  # "" if the site belongs to no arm
    channel: str
    unit: str
    low: float
    low_permille: float  # 0.1 % of the ticks were below
    high_permille: float  # 0.1 % of the ticks were above
    high: float
    ticks: float = 0  # number of ticks that were measured; 0: the range is that of the design


@dataclasses.dataclass(frozen=True)
class Site:
    """One signal of the tick into which faults can be injected."""

    name: str
    layer: str  # code of the robot's layer: L1 console .. L10 mechanics
    per_arm: bool  # True if each arm has this signal
    channels: tuple[Channel, ...]
    where: str  # position of the site, relative to the checks
    unread: bool = False  # True if nothing in the tick reads the signal
    beyond: str = ""  # setting that permits values beyond 16 bits; "": the key `wraps`

    def channel(self, name: str) -> Channel:
        """Return the channel `name`. Raise KeyError with a list of the channels."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(
            f"site {self.name} has no channel {name!r}; it has"
            f" {', '.join(c.name for c in self.channels)}"
        )
