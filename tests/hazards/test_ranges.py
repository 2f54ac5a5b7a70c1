"""Normal operating ranges are complete."""

from __future__ import annotations

import math

from ravenjax.hazards import ranges
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.declaration import SITES


def test_every_channel_that_a_fault_can_strike_has_a_range() -> None:
    expected = {
        (site.name, arm, channel.name): channel.unit
        for site in SITES.values()
        for arm in (ARMS if site.per_arm else ("",))
        for channel in site.channels
    }
    assert {key: usual.unit for key, usual in ranges.measured().items()} == expected


def test_ranges_hold_what_is_known_of_fault_free_motion() -> None:
    assert ranges.normal("packet_header", "surgeon_mode")[4:8] == (0, 0, 1, 1)
    assert ranges.normal("plc", "runlevel").low == 2  # no run stops
    assert ranges.normal("packet_header", "size").low == 124  # bytes of a datagram of increments
    shoulder = ranges.normal("jpos", "shoulder", "gold")
    assert (
        0.0 < shoulder.low < math.radians(30.0) < shoulder.high < math.pi / 2
    )  # home and soft limits
