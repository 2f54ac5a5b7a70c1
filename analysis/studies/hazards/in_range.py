"""Determines whether the values of a fault stay inside the normal ranges of its channels, the
ranges in fault-free motion.
"""

import math
from collections.abc import Sequence

import numpy as np

from ravenjax.hazards.library import LibraryFault, Number, Numbers
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.declaration import ROBOT, SITES
from ravenjax.vocabulary.sites import ChannelRange

IN, OUT, EITHER = "in range", "out of range", "in and out of range"
RUN_MS = 3000
"""Assumed length of a window without end, for effects that grow with it."""


def verdict(struck: LibraryFault, arm: str = ARMS[0]) -> str:
    """Return whether the channel values under a fault lie in their normal ranges: IN, OUT or
    EITHER.

    EITHER: some of its values, channels or moments are in range, others are not. It is also
    returned for bit flips, whose effect depends on the number itself.
    """
    ticks = max(RUN_MS if item == "end" else int(item) for item in _numbers(struck.duration_ms))
    drawn = isinstance(struck.value, dict) and "choice" not in struck.value
    numbers = _numbers(0 if struck.value is None else struck.value)
    verdicts = {
        within(
            struck.effect,
            np.array(values) * (struck.along[channel] if struck.along else 1.0),
            ROBOT.normal_range(struck.site, channel, arm),
            ticks,
        )
        for channel in struck.channels
        for values in ([numbers] if drawn else [[number] for number in numbers])
    }
    return verdicts.pop() if len(verdicts) == 1 else EITHER


def _numbers(value: Numbers | str) -> list[Number]:
    """Return the numbers of a list, or those of a distribution: its ends, or its choices."""
    if isinstance(value, dict):
        (value,) = value.values()
    return list(value) if isinstance(value, tuple) else [value]


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
    first, last = (math.floor((end + 2**15) / 2**16) for end in (low, high))
    return (low - first * 2**16, high - first * 2**16) if first == last else None
