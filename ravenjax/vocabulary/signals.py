"""Defines the signals of a robot that users' checks and detectors may read.

A robot lists its signals in `Robot.signals`. `ravenjax monitor` can watch the same signals.
"""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Signal:
    """One signal of an arm that users' checks and detectors can read."""

    field: str  # name of the signal, a field of the view
    layer: str  # code of the robot's layer that computes the signal
    meaning: str
    unit: str  # unit of all channels that `units` does not contain
    channels: tuple[str, ...]  # channels of a vector, in order; (): a single number
    units: tuple[tuple[str, str], ...] = ()  # (channel, unit) of channels with another unit
    together: tuple[tuple[str, tuple[str, ...]], ...] = ()  # (name, channels) with one score
    bounded: bool = False  # True if a limit on the magnitude of the signal is useful
    steps: bool = True  # True if a limit on the step within 1 ms is useful
    against: tuple[str, ...] = ()  # signals with the same channels and units and similar values

    def unit_of(self, channel: str) -> str:
        """Return the unit of a channel."""
        return dict(self.units).get(channel, self.unit)
