"""Defines the seams of a robot: the signals between two parts of its tick.

A fault acts at a fault site (`ravenjax.vocabulary.sites`). Its effect can be observed at a seam.
Most seams are also fault sites. A robot declares its seams in the order of its tick.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple


class SeamChannel(NamedTuple):
    """One number of a seam."""

    name: str
    unit: str
    site: str = ""  # fault site whose channel of this name has the normal range; "": none
    path: tuple[str | int, ...] = ()  # from the signals of a tick to the number, as in a site


@dataclasses.dataclass(frozen=True)
class Seam:
    """Numbers that one part of the tick hands to the next together."""

    name: str
    layer: str  # layer code of the fault sites around it
    per_arm: bool
    channels: tuple[SeamChannel, ...]
    meaning: str


class Crossing(NamedTuple):
    """One number that crosses a seam in each tick."""

    seam: Seam
    arm: str  # "" if the seam belongs to no arm
    channel: SeamChannel

    @property
    def name(self) -> str:
        """The number's name in tables: gold/mpos/shoulder."""
        return "/".join(part for part in (self.arm, self.seam.name, self.channel.name) if part)

    @property
    def signal(self) -> str:
        """The name of its seam for this arm: gold/mpos."""
        return "/".join(part for part in (self.arm, self.seam.name) if part)


def list_crossings(seams: Mapping[str, Seam], arms: Iterable[str]) -> tuple[Crossing, ...]:
    """Return every number that crosses a seam of a robot with these arms, in order."""
    arms = tuple(arms)
    return tuple(
        Crossing(seam, arm, channel)
        for seam in seams.values()
        for arm in (arms if seam.per_arm else ("",))
        for channel in seam.channels
    )
