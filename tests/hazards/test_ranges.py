"""Normal operating ranges: complete, and what they say of a fault's values."""

from __future__ import annotations

import math

import pytest

from ravenjax.errors import UserError
from ravenjax.hazards import library, ranges
from ravenjax.hazards.library import Struck
from ravenjax.hazards.ranges import EITHER, IN, OUT, ChannelRange
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.sites import SITES

USUAL = ChannelRange("mpos", "gold", "shoulder", "rad", -2.0, -1.9, 2.9, 3.0, 1000)
COUNTS = ChannelRange("usb_out", "gold", "shoulder", "cnt", -800.0, -700.0, 700.0, 800.0, 1000)


def test_every_channel_that_a_fault_can_strike_has_a_range() -> None:
    expected = {
        (site.name, arm, channel.name): channel.unit
        for site in SITES.values()
        for arm in (ARMS if site.per_arm else ("",))
        for channel in site.channels
    }
    assert {key: usual.unit for key, usual in ranges.measured().items()} == expected


def test_ranges_are_in_order_and_of_many_ticks() -> None:
    for usual in ranges.measured().values():
        assert usual.low <= usual.low_permille <= usual.high_permille <= usual.high
        assert math.isfinite(usual.low + usual.high)
        assert usual.ticks >= 100_000


def test_ranges_hold_what_is_known_of_fault_free_motion() -> None:
    assert ranges.normal("packet_header", "surgeon_mode")[4:8] == (0, 0, 1, 1)
    assert ranges.normal("plc", "runlevel").low == 2  # no run stops
    assert ranges.normal("packet_header", "size").low == 124  # bytes of a datagram of increments
    shoulder = ranges.normal("jpos", "shoulder", "gold")
    assert (
        0.0 < shoulder.low < math.radians(30.0) < shoulder.high < math.pi / 2
    )  # home and soft limits


@pytest.mark.parametrize(
    ("effect", "values", "verdict"),
    [
        ("overwrite", [1.0], IN),
        ("overwrite", [3.1], OUT),
        ("overwrite", [2.0, 4.0], EITHER),
        ("offset", [0.0], IN),
        ("offset", [1.0], EITHER),
        ("offset", [5.1], OUT),
        ("latch_offset", [-5.1], OUT),
        ("scale", [0.5], IN),
        ("scale", [-1.0], EITHER),
        ("drift", [0.001], EITHER),
        ("drift", [0.0], IN),
        ("stuck", [0.0], IN),
        ("random", [2.0], IN),
        ("random", [2.5], EITHER),
        ("toggle", [3.5], EITHER),
        ("periodic", [0.1], EITHER),
        ("bit_flip", [3.0], EITHER),
    ],
)
def test_within(effect: str, values: list[float], verdict: str) -> None:
    assert ranges.within(effect, values, USUAL, ticks=1000) == verdict


@pytest.mark.parametrize(
    ("effect", "value", "verdict"),
    [
        ("overwrite", 65536.0 + 700.0, IN),  # wraps to 700
        ("overwrite", 40000.0, OUT),  # wraps to -25536
        ("latch_offset", 200000.0, OUT),  # wraps to 3392 +- 800
        ("offset", 65536.0, IN),
        ("offset", 32768.0, EITHER),  # the lower half wraps, the upper does not
    ],
)
def test_motor_commands_wrap_at_16_bits(effect: str, value: float, verdict: str) -> None:
    assert ranges.within(effect, [value], COUNTS) == verdict


def test_verdicts_of_library_rows() -> None:
    def of(name: str) -> list[str]:
        return [ranges.verdict(struck) for case in library.find(name).case for struck in case.fault]

    assert of("K01") == [OUT]  # joints at 0, 100, 1000
    assert of("K06") == [IN]  # -1000 counts is a command that the robot gives
    assert of("C08") == [EITHER, OUT]  # in range, and +-200 000
    assert of("K19")[-1] == OUT


def test_channels_struck_together_take_their_shares() -> None:
    size = ranges.normal("pos_d", "x").high - ranges.normal("pos_d", "x").low
    fault = {"site": "pos_d", "effect": "offset", "unit": "um", "start_ms": 0}
    far = Struck.model_validate({**fault, "along": {"x": 0.5}, "value": 2.1 * size})
    near = Struck.model_validate({**fault, "along": {"x": 0.5}, "value": 1.9 * size})
    assert (ranges.verdict(far), ranges.verdict(near)) == (OUT, EITHER)


def test_an_unknown_channel_is_told() -> None:
    with pytest.raises(
        UserError, match=r"no normal range of channel 'nose' at site 'mpos', arm 'gold'"
    ):
        ranges.normal("mpos", "nose")
