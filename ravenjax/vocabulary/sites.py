"""What a fault site is: a seam of a robot's tick, its channels, number types and units. Knows
nothing of any robot.

A robot declares its sites in its own order. The machinery of `ravenjax.faults` is given a site's
signal and, from the declaration, the path of each channel inside it. `ARM` in a path stands for the
arm's place in `setup.arms`.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

ARM = "ARM"
Kind = Literal["int16", "int24", "int32", "float", "bool"]
"""Type of a number; an int24, which an encoder's word is, travels as int32 and nothing makes it
wrap.
"""


@dataclasses.dataclass(frozen=True)
class Field:
    """What a number may be where it has fewer values than its type; both ends included."""

    low: int
    high: int
    noun: str
    bits: int


BITS: dict[Kind, int] = {"int16": 16, "int24": 24, "int32": 32, "float": 32, "bool": 1}


@dataclasses.dataclass(frozen=True)
class Channel:
    """One number of a site's signal."""

    name: str
    path: tuple[str | int, ...]  # attributes and indices from the site's signal to the number
    kind: Kind
    unit: str
    field: Field | None = None  # None: whatever its type holds

    @property
    def bits(self) -> int:
        """Width of its number."""
        return BITS[self.kind] if self.field is None else self.field.bits

    @property
    def extent(self) -> tuple[float | None, float | None]:
        """Least and greatest number that it holds; None, None for a float."""
        if self.field is not None:
            return self.field.low, self.field.high
        if self.kind == "float":
            return None, None
        if self.kind == "bool":
            return 0, 1
        half = 2 ** (self.bits - 1)
        return -half, half - 1


@dataclasses.dataclass(frozen=True)
class Site:
    """One seam of the tick."""

    name: str
    layer: str  # layer code of the fault library: L1 console .. L10 mechanics
    per_arm: bool
    channels: tuple[Channel, ...]
    where: str  # when it acts, relative to the checks
    # what a file writes where values are meant that its words do not hold; "": the fault's `wraps`
    beyond: str = ""

    def channel(self, name: str) -> Channel:
        """The channel of that name; KeyError lists those there are."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(
            f"site {self.name} has no channel {name!r}; it has"
            f" {', '.join(c.name for c in self.channels)}"
        )
