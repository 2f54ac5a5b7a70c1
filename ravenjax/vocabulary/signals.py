"""The signals that users' files may see of a robot, by name: the fields of its view, as data. Knows
nothing of any robot.

A robot declares those of its view's fields that a monitor can be built on (`Robot.signals`); the
view itself is code.
"""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Signal:
    """One field of a robot's view of an arm."""

    field: str  # of the view
    layer: str  # code of the robot's layer whose work it is
    meaning: str
    unit: str  # of every channel that `units` does not name
    channels: tuple[str, ...]  # of a vector, in order; (): a single number
    units: tuple[tuple[str, str], ...] = ()  # (channel, unit) of those with another unit
    together: tuple[
        tuple[str, tuple[str, ...]], ...
    ] = ()  # (name, channels) looked at apart from the others
    bounded: bool = False  # whether its size alone says something, zero being its middle
    steps: bool = True  # whether its step within 1 ms does
    against: tuple[str, ...] = ()  # fields of the same channels and units that it should be near

    def unit_of(self, channel: str) -> str:
        """Unit of a channel."""
        return dict(self.units).get(channel, self.unit)
