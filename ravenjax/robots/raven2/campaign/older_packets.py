"""Bounds the age of the packets that network faults send again, if packet lengths are drawn.

Without draws, the place of an older packet in the motion follows from its number. With draws, the
tick remembers when packets were sent, and must know beforehand for how long.
"""

import math
from collections.abc import Iterable

from ravenjax.campaign.file.group import ALL, Fault, Group
from ravenjax.stages.channel import DELAY_MS, JITTER_MS
from ravenjax.vocabulary.effects import NETWORK_EFFECTS

LONGEST_MS = 8192
"""The longest history that a tick keeps.

It has 256 words, and needs 9 000 operations beside 11 400 of the rest of a tick.
"""

_CHANNELS = ("lag", "delay")
"""Channels whose unit is packets."""
_JITTER_MS = math.ceil(DELAY_MS[1] + JITTER_MS[1])
_ALONE = ("overwrite", "offset", "latch_offset", "periodic", "random", "toggle")
"""Effects that add no more than their value to a channel that other faults change."""


def age_ms(groups: Iterable[Group], longest: int) -> float:
    """Return the age of the oldest packet of all runs, ms; 0: none is sent again; may be infinite.

    longest: largest number of cycles that a packet lasts.
    """
    runs = (
        faults
        for group in groups
        for faults in (group.fault, *(group.faults_of(run) for run in group.run))
    )
    return max((_age_ms(faults, longest) for faults in runs), default=0.0)


def _age_ms(faults: Iterable[Fault], longest: int) -> float:
    """Return the same age for one run, or for runs that differ in values only."""
    counts = [
        count
        for fault in faults
        if fault.site == "network"
        for count in [_packets(fault)]
        if count is not None
    ]
    late = any(fault.site == "network" and "jitter" in _channels(fault) for fault in faults)
    if not counts and not late:
        return 0.0
    # The packet before it is needed, too, because increments count from it. And the newest packet
    # may be `longest` old when it is needed.
    return (sum(counts) + 2) * longest + (_JITTER_MS if late else 0)


def _packets(fault: Fault) -> float | None:
    """Return the longest delay by a fault of the network, in packets; None for another channel."""
    if not set(_channels(fault)) & set(_CHANNELS):
        return None
    most = 0.0
    for name in fault.effect.listed:
        _, effect, value = NETWORK_EFFECTS.get(name, ("", name, None))
        if effect == "stuck":
            continue
        if effect not in _ALONE:
            return math.inf
        numbers = () if fault.value is None else fault.value.listed or fault.value.extent
        most = max(most, *(abs(number) for number in (numbers if value is None else (value,))), 0.0)
    return most


def _channels(fault: Fault) -> set[str]:
    """Return the channels of site network on which a fault may act."""
    bound = {
        NETWORK_EFFECTS[effect].channel
        for effect in fault.effect.listed
        if effect in NETWORK_EFFECTS
    }
    listed = () if fault.channel is None else fault.channel.listed
    return bound | ({*_CHANNELS, "jitter"} if ALL in listed else set(listed))
