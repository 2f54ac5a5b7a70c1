"""Defines the signals of a robot that users' checks and detectors may read.

A robot declares the signals that a monitor can use in `Robot.signals`.
"""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Signal:
    """One field of a robot's view of an arm."""

    field: str  # field of the view
    layer: str  # code of the robot's layer that produces it
    meaning: str
    unit: str  # unit of every channel that `units` does not name
    channels: tuple[str, ...]  # channels of a vector, in order; (): a single number
    units: tuple[tuple[str, str], ...] = ()  # (channel, unit) of channels with another unit
    together: tuple[tuple[str, tuple[str, ...]], ...] = ()  # (name, channels) evaluated separately
    bounded: bool = False  # whether its magnitude alone is meaningful, with zero in the middle
    steps: bool = True  # whether its step within 1 ms is meaningful
    against: tuple[str, ...] = ()  # fields of the same channels and units that should be near it

    def unit_of(self, channel: str) -> str:
        """Return the unit of a channel."""
        return dict(self.units).get(channel, self.unit)
