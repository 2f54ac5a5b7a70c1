"""Determines whether a fault leaves its channels in their normal ranges."""

import math
from collections.abc import Sequence
from typing import Any

from ravenjax.hazards import ranges
from ravenjax.hazards.library import Number, Numbers, Struck
from ravenjax.hazards.ranges import ChannelRange
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.declaration import SITES

IN, OUT, EITHER = "in range", "out of range", "in and out of range"
RUN_MS = 3000
"""Assumed length of a window without end, for effects that grow with it."""


def verdict(struck: Struck, arm: str = ARMS[0]) -> str:
    """Return whether the channel values under a fault lie in their normal ranges: IN, OUT or
    EITHER.

    EITHER: some of its values, channels or moments are in range, others are not. It is also
    returned for bit flips, whose effect depends on the number itself.
    """
    verdicts = set()
    for channel in struck.channels:
        share = struck.along[channel] if struck.along else 1.0
        usual, ticks = ranges.normal_range(struck.site, channel, arm), _longest(struck.duration_ms)
        for values in _values(struck.value):
            verdicts.add(within(struck.effect, [share * value for value in values], usual, ticks))
    return verdicts.pop() if len(verdicts) == 1 else EITHER


def within(effect: str, values: Sequence[float], usual: ChannelRange, ticks: int = RUN_MS) -> str:
    """Return IN, OUT or EITHER for a channel while an effect acts for `ticks` with any value
    between `values`.
    """
    spans = [reach(effect, value, usual, ticks) for value in values]
    ends = [end for span in spans if span is not None for end in span]
    span = _stored(usual, min(ends), max(ends)) if ends else None
    if span is None:
        return EITHER
    low, high = span
    if usual.low <= low and high <= usual.high:
        return IN
    return OUT if high < usual.low or low > usual.high else EITHER


def reach(
    effect: str, value: float, usual: ChannelRange, ticks: int = RUN_MS
) -> tuple[float, float] | None:
    """Return the least and greatest number that an effect makes of a channel that would stay in its
    normal range; None: any.
    """
    low, high = usual.low, usual.high
    ends = {
        "overwrite": (value, value),
        "offset": (low + value, high + value),
        "latch_offset": (low + value, high + value),
        "scale": (low * value, high * value),
        "drift": (low + value, high + value, low + value * ticks, high + value * ticks),
        "stuck": (low, high),
        "periodic": (low - abs(value), high + abs(value)),
        "random": (-abs(value), abs(value)),
        "toggle": (value, 0.0),
        "drop": (1.0, 1.0),
        "duplicate": (1.0, 1.0),
        "delay": (value, value),
    }.get(effect)
    return None if ends is None else (min(ends), max(ends))


def _stored(usual: ChannelRange, low: float, high: float) -> tuple[float, float] | None:
    """Return a range as the channel stores it. 16-bit numbers wrap; None if part of the
    range does.
    """
    if SITES[usual.site].channel(usual.channel).kind != "int16":
        return low, high
    turns = math.floor((low + 2**15) / 2**16)
    if turns != math.floor((high + 2**15) / 2**16):
        return None
    return low - turns * 2**16, high - turns * 2**16


def _values(value: Numbers | None) -> list[tuple[Number, ...]]:
    """Return single values, and both ends of drawn ranges."""
    if value is None:
        return [(0,)]
    if isinstance(value, dict):
        (kind, numbers), *_ = value.items()
        return [(number,) for number in numbers] if kind == "choice" else [numbers]
    return [(number,) for number in value] if isinstance(value, tuple) else [(value,)]


def _longest(duration: Any) -> int:
    """Return the longest of the durations, ms. A duration without end counts as RUN_MS."""
    listed = duration.values() if isinstance(duration, dict) else [duration]
    flat = [item for one in listed for item in (one if isinstance(one, tuple) else (one,))]
    return max(RUN_MS if item == "end" else int(item) for item in flat)
