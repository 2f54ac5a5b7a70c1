"""What normal ranges say of a fault's values."""

import pytest

from ravenjax.vocabulary.sites import ChannelRange
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
