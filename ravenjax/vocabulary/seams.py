"""Defines the seams of a robot: the signals between two parts of its tick.

A fault acts at a fault site (`ravenjax.vocabulary.sites`). Its effect can be observed at a seam.
Most seams are also fault sites. A robot declares its seams in the order of its tick.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple

DIFFERS, LEAVES = "differs:", "leaves:"
NEAR, GOLDEN_NEAR, NEAR_MS = "near:", "golden_near:", "near_ms:"
"""Prefixes of columns of explained runs: ticks of a number, and margins of a check until harm."""


class SeamChannel(NamedTuple):
    """One number of a seam."""

    name: str
    unit: str
    site: str = ""  # fault site with a channel of this name and a normal range; "": none
    # names, attributes and indices, from the loop's `name_signals` to the number; ARM: of the arm
    path: tuple[str | int, ...] = ()


@dataclasses.dataclass(frozen=True)
class Seam:
    """A signal between two parts of the tick. It may consist of several numbers."""

    name: str
    layer: str  # layer code of the nearest fault sites
    per_arm: bool
    channels: tuple[SeamChannel, ...]
    meaning: str
    # path of a number that is 0 in ticks without this signal; (): every tick has the signal
    present: tuple[str, ...] = ()


class Crossing(NamedTuple):
    """One number of a seam, for one arm."""

    seam: Seam
    arm: str  # "" if the seam does not belong to an arm
    channel: SeamChannel

    @property
    def name(self) -> str:
        """The number's name in tables, such as gold/mpos/shoulder."""
        return "/".join(part for part in (self.arm, self.seam.name, self.channel.name) if part)

    @property
    def signal(self) -> str:
        """The name of the seam for this arm, such as gold/mpos."""
        return "/".join(part for part in (self.arm, self.seam.name) if part)


def list_crossings(seams: Mapping[str, Seam], arms: Iterable[str]) -> tuple[Crossing, ...]:
    """Return all numbers of the seams of a robot with these arms, in order."""
    arms = tuple(arms)
    return tuple(
        Crossing(seam, arm, channel)
        for seam in seams.values()
        for arm in (arms if seam.per_arm else ("",))
        for channel in seam.channels
    )
