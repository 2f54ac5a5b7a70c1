"""What normal ranges say of a fault's values."""

from __future__ import annotations

import pytest

from ravenjax.hazards import library, ranges
from ravenjax.hazards.library import Struck
from ravenjax.hazards.ranges import ChannelRange
from studies.hazards import in_range
from studies.hazards.in_range import EITHER, IN, OUT

USUAL = ChannelRange("mpos", "gold", "shoulder", "rad", -2.0, -1.9, 2.9, 3.0, 1000)
COUNTS = ChannelRange("usb_out", "gold", "shoulder", "cnt", -800.0, -700.0, 700.0, 800.0, 1000)


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
    assert in_range.within(effect, values, USUAL, ticks=1000) == verdict


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
    assert in_range.within(effect, [value], COUNTS) == verdict


def test_verdicts_of_library_rows() -> None:
    def of(name: str) -> list[str]:
        return [
            in_range.verdict(struck) for case in library.find(name).case for struck in case.fault
        ]

    assert of("K01") == [OUT]  # joints at 0, 100, 1000
    assert of("K06") == [IN]  # -1000 counts is a command that the robot gives
    assert of("C08") == [EITHER, OUT]  # in range, and +-200 000
    assert of("K19")[-1] == OUT


def test_channels_struck_together_take_their_shares() -> None:
    size = ranges.normal("pos_d", "x").high - ranges.normal("pos_d", "x").low
    fault = {"site": "pos_d", "effect": "offset", "unit": "um", "start_ms": 0}
    far = Struck.model_validate({**fault, "along": {"x": 0.5}, "value": 2.1 * size})
    near = Struck.model_validate({**fault, "along": {"x": 0.5}, "value": 1.9 * size})
    assert (in_range.verdict(far), in_range.verdict(near)) == (OUT, EITHER)
