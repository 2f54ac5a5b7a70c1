"""Decides which values a fault effect may have at a channel.

A value must fit the channel's number type, so that the stored value equals the value in the
campaign file. A DAC word has 16 bits. A larger value needs the campaign's permission.
"""

import math
from typing import NamedTuple

import numpy as np

from ravenjax.vocabulary.effects import EFFECTS
from ravenjax.vocabulary.sites import BITS, Channel, Site

WORD = (-(2**15), 2**15 - 1)
"""Range of a 16-bit word, such as a DAC command."""

COUNTER = (-(2**23), 2**23 - 1)
"""Range of a 24-bit word, such as an encoder count."""


class Legal(NamedTuple):
    """The values that one effect may have at one channel; both ends are included."""

    expected: str  # description of the values, for error messages
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False  # only whole numbers
    rounded: bool = False  # a drawn value is rounded to a whole number


def legal_values(channel: Channel, effect: str, beyond: bool = False) -> Legal:
    """Return the values that `effect` may have at `channel`. beyond: permit more than 16 bits."""
    name, kind = channel.name, channel.kind
    if effect == "bit_flip":
        noun = kind if channel.field is None else channel.field.noun
        high = channel.bits - 1
        expected = f"bit_flip at {name} ({noun}) takes the index of a bit, 0..{high}"
        return Legal(expected, 0, high, whole=True, rounded=True)
    if effect == "delay":
        expected = "delay takes a whole number of packets from 1 to 100000"
        return Legal(expected, 1, 100_000, whole=True, rounded=True)
    if effect == "lose":
        return Legal("lose takes a probability from 0 to 1", 0, 1)
    # The value of an offset has the channel's number type and unit, that of a drift has only its
    # unit, and that of a scale neither.
    has_type, has_unit = EFFECTS[effect].of_its_type, EFFECTS[effect].in_its_unit
    if kind == "bool":
        expected = f"{name} is a truth value: expected 0 or 1"
        return Legal(expected, 0, 1, whole=True, rounded=has_type)
    if kind == "int16" and has_unit and not beyond:
        low, high = WORD
    elif kind == "int24" and has_unit:
        low, high = COUNTER
    elif kind != "float" and has_type:
        # An int32, or an int16 that may have more bits. The range lacks the smallest int32.
        low, high = 1 - 2**31, 2**31 - 1
    else:
        return Legal("any number")
    expected = f"{name} is a {BITS[kind]}-bit number: expected {low}..{high}"
    return Legal(expected, low, high, whole=has_type, rounded=has_type)


def find_illegal_value(
    site: Site, channel: Channel, effect: str, value: float, beyond: bool
) -> str:
    """Return the message for a value that `legal_values` does not permit at this channel."""
    legal = legal_values(channel, effect, beyond)
    refusal = f"{legal.expected}, got {value:.10g}"
    if channel.kind == "bool" or effect in ("bit_flip", "delay", "lose"):
        return refusal
    if value % 1 and legal.whole:
        return f"{channel.name} is a whole number ({channel.unit}): got {value:g}"
    if channel.kind != "int16" or beyond or abs(value) >= 2**31:
        return refusal
    # A word of 16 bits stores the value modulo 2^16.
    stored = (math.trunc(value) - WORD[0]) % 2**16 + WORD[0]
    permission = site.beyond or "wraps = true here"
    return f"{refusal}, which would wrap to {stored}; if that is meant, write {permission}"


def find_rounding(channel: Channel, effect: str, value: float) -> str | None:
    """Return an error message if single precision would change a whole number, else None."""
    is_whole_number = channel.kind not in ("float", "bool") and EFFECTS[effect].of_its_type
    # `legal_values` refuses larger numbers, and NaN.
    if not is_whole_number or not abs(value) < 2**31:
        return None
    nearest = np.float32(value)
    if float(nearest) == value:
        return None
    # A number just below 2^31 is rounded up to 2^31, which is no int32. The number that the message
    # proposes is then the next smaller one.
    if abs(nearest) >= 2**31:
        nearest = np.nextafter(nearest, np.float32(0))
    return (
        "values are stored in single precision, which cannot represent all whole numbers above"
        f" 2^24: got {value:.10g}, write {int(nearest)}"
    )
