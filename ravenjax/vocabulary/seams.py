"""What crosses from one part of a robot's tick to the next: seams, and the numbers of each. Knows
nothing of any robot.

A fault site (`ravenjax.vocabulary.sites`) is where a fault can act; a seam is where its effect can
be looked for. Most are both. A robot declares its seams in the order of its tick.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple


class SeamChannel(NamedTuple):
    """One number of a seam."""

    name: str
    unit: str
    # fault site whose channel of this name has its normal range; "": nobody measured one
    site: str = ""
    # attributes and indices from the signals of a tick to the number, as of a site
    path: tuple[str | int, ...] = ()


@dataclasses.dataclass(frozen=True)
class Seam:
    """Numbers that one part of the tick hands to the next together."""

    name: str
    layer: str  # code of the layer of the fault sites around it
    per_arm: bool
    channels: tuple[SeamChannel, ...]
    meaning: str


class Crossing(NamedTuple):
    """One number that crosses a seam in each tick."""

    seam: Seam
    arm: str  # "" where the seam belongs to no arm
    channel: SeamChannel

    @property
    def name(self) -> str:
        """As a table has it: gold/mpos/shoulder."""
        return "/".join(part for part in (self.arm, self.seam.name, self.channel.name) if part)

    @property
    def signal(self) -> str:
        """What its seam of this arm is called: gold/mpos."""
        return "/".join(part for part in (self.arm, self.seam.name) if part)


def crossings(seams: Mapping[str, Seam], arms: Iterable[str]) -> tuple[Crossing, ...]:
    """Every number that crosses a seam of a robot with these arms: seam by seam, arm by arm."""
    arms = tuple(arms)
    return tuple(
        Crossing(seam, arm, channel)
        for seam in seams.values()
        for arm in (arms if seam.per_arm else ("",))
        for channel in seam.channels
    )
