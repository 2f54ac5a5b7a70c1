"""Which values an effect takes at a channel. A DAC value beyond 16 bit is legal: it wraps."""

from __future__ import annotations

import math
from typing import NamedTuple

from ravenjax.robot.sites import Channel

BITS = {"int16": 16, "int32": 32, "float": 32, "bool": 1}
"""Width of a channel's number, for bit_flip."""


class Legal(NamedTuple):
    """The values that one effect may have at one channel, both ends included."""

    low: float = -math.inf
    high: float = math.inf
    whole: bool = False  # nothing but whole numbers
    rounded: bool = False  # a drawn value is rounded to a whole one


def legal(channel: Channel, effect: str) -> Legal:
    """The values of `effect`, one that takes a value, at `channel`."""
    if effect == "bit_flip":
        return Legal(0, BITS[channel.kind] - 1, whole=True, rounded=True)
    if effect == "delay":
        return Legal(1, 100_000, whole=True, rounded=True)
    in_kind = effect in ("overwrite", "toggle", "offset", "latch_offset")  # the value is of the channel's own type
    if channel.kind == "bool":
        return Legal(0, 1, whole=True, rounded=in_kind)
    if channel.kind != "float" and in_kind:
        return Legal(1 - 2**31, 2**31 - 1, whole=True, rounded=True)
    return Legal()


def complaint(channel: Channel, effect: str, value: float) -> str:
    """What to say of a value that is not legal."""
    low, high, _, _ = legal(channel, effect)
    if effect == "bit_flip":
        return f"bit_flip at {channel.name} ({channel.kind}) takes the index of a bit, 0..{high}, got {value:g}"
    if effect == "delay":
        return f"delay takes a whole number of packets from {low} to {high}, got {value:g}"
    if channel.kind == "bool":
        return f"{channel.name} is a truth value: expected 0 or 1, got {value:g}"
    if value != math.floor(value):
        return f"{channel.name} is a whole number ({channel.unit}): got {value:g}"
    return f"{channel.name} is a 32-bit number: expected {low}..{high}, got {value:g}"
