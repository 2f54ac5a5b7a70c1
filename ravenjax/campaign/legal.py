"""Which values an effect takes at a channel.

A value must fit the channel's number: what is stored is then what the file says. A DAC word has 16 bits, and a value
beyond them is accepted only where the campaign says that it is meant: see `says_beyond`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ravenjax.campaign.config import Campaign
from ravenjax.campaign.group import Fault
from ravenjax.robot.sites import Channel

BITS = {"int16": 16, "int24": 24, "int32": 32, "float": 32, "bool": 1}
"""Width of a channel's number, for bit_flip."""

FIELDS = {
    "rl_desired": (0, 3, "a run level", 2),
    "runlevel": (0, 3, "a run level", 2),
    "pins": (0, 255, "a byte", 8),
    "size": (0, 65507, "the length of a datagram", 16),
}
"""Channels whose number has fewer values than its type: least, greatest and what it is, for what writes it anew; and
its width in bits."""

WORD = (-(2**15), 2**15 - 1)
"""What a 16-bit word holds, of a DAC command."""

COUNTER = (-(2**23), 2**23 - 1)
"""What a 24-bit word holds, of an encoder."""

USB_SITE = "usb_out"
"""The site whose words `campaign.dac_words` is about."""

_OF_ITS_TYPE = ("overwrite", "toggle", "offset", "latch_offset")
"""Effects whose value is a number of the channel's own type."""
_OF_ITS_UNIT = (*_OF_ITS_TYPE, "drift", "periodic", "random")
"""Effects whose value is in the channel's unit."""


class Legal(NamedTuple):
    """The values that one effect may have at one channel, both ends included."""

    low: float = -math.inf
    high: float = math.inf
    whole: bool = False  # nothing but whole numbers
    rounded: bool = False  # a drawn value is rounded to a whole one


def legal(channel: Channel, effect: str, beyond: bool = False) -> Legal:
    """The values of `effect`, one that takes a value, at `channel`; `beyond`: a 16-bit word may be given more."""
    if effect == "bit_flip":
        return Legal(0, bits(channel) - 1, whole=True, rounded=True)
    if effect == "delay":
        return Legal(1, 100_000, whole=True, rounded=True)
    of_its_type = effect in _OF_ITS_TYPE
    if channel.kind == "bool":
        return Legal(0, 1, whole=True, rounded=of_its_type)
    if channel.kind == "int16" and effect in _OF_ITS_UNIT and not beyond:
        return Legal(*WORD, whole=of_its_type, rounded=of_its_type)
    if channel.kind == "int24" and effect in _OF_ITS_UNIT:
        return Legal(*COUNTER, whole=of_its_type, rounded=of_its_type)
    if channel.kind != "float" and of_its_type:
        return Legal(1 - 2**31, 2**31 - 1, whole=True, rounded=True)
    return Legal()


def bits(channel: Channel) -> int:
    """Width of a channel's number."""
    return FIELDS[channel.name][3] if channel.name in FIELDS else BITS[channel.kind]


def says_beyond(campaign: Campaign, fault: Fault) -> bool:
    """Whether values beyond 16 bits are meant: the fault has `wraps`, or strikes USB words and `dac_words` is set."""
    return fault.wraps or (fault.site == USB_SITE and campaign.dac_words is not None)


def complaint(site: str, channel: Channel, effect: str, value: float, beyond: bool = False) -> str:
    """What to say of a value that is not legal at this channel of `site`."""
    low, high, _, _ = legal(channel, effect, beyond)
    if effect == "bit_flip":
        kind = FIELDS[channel.name][2] if channel.name in FIELDS else channel.kind
        return f"bit_flip at {channel.name} ({kind}) takes the index of a bit, 0..{high}, got {value:g}"
    if effect == "delay":
        return f"delay takes a whole number of packets from {low} to {high}, got {value:g}"
    if channel.kind == "bool":
        return f"{channel.name} is a truth value: expected 0 or 1, got {value:g}"
    if value != math.floor(value) and effect in _OF_ITS_TYPE:
        return f"{channel.name} is a whole number ({channel.unit}): got {value:g}"
    if channel.kind == "int16" and not beyond:
        refusal = f"{channel.name} is a 16-bit number: expected {WORD[0]}..{WORD[1]}, got {value:.10g}"
        if abs(value) >= 2**31:
            return refusal
        way = (
            'dac_words = "wrap" (or "saturate", "unwrapped") in [campaign]' if site == USB_SITE else "wraps = true here"
        )
        stored = (math.trunc(value) - WORD[0]) % 2**16 + WORD[0]
        return f"{refusal}, which would wrap to {stored}; if that is meant, write {way}"
    return f"{channel.name} is a {BITS[channel.kind]}-bit number: expected {low}..{high}, got {value:.10g}"


def rounding(channel: Channel, effect: str, value: float) -> str | None:
    """What to say of a whole number that single precision, in which values travel, would change; None if it is held."""
    if channel.kind in ("float", "bool") or effect not in _OF_ITS_TYPE or not abs(value) < 2**31:
        return None
    held = float(np.float32(value))
    if held == value:
        return None
    nearest = int(held) if abs(held) < 2**31 else int(np.nextafter(np.float32(held), np.float32(0)))
    return (
        f"values travel in single precision, which holds every whole number to 2^24 only: got {value:.10g}, write "
        f"{nearest}"
    )
