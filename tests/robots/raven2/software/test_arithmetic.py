"""The compiled control software against the interpreted one: every bit of every number, tick for
tick.
"""

import numpy as np
import pytest
from drives import Drive

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.transition import RecordKind
from ravenjax.numbers.setup import CAMPAIGN, REFERENCE
from ravenjax.robots.raven2.software.control_software import ControlSoftware

PARTS = {
    "raven2, first": ({}, 0.01),
    "raven2, third": ({}, 0.05),
    "raven2, in pedal-down": ({"runlevel": 3}, 0.01),
    "square tools, beginner": ({"tools": ("r_sq_grasper",) * 2, "level": "beginner"}, 0.01),
    "coupled wrist, hard policy": (
        {"tools": ("large_needle",) * 2, "policy": "hard_regulation"},
        0.01,
    ),
    "fork2015": ({"software": "fork2015"}, 0.01),
    "fork2015, absolute poses": ({"software": "fork2015", "console": "absolute"}, 0.01),
}
"""Options of the software, and how often something is what it should not be."""


def same_bits(kind: RecordKind, one: np.ndarray | bytes, other: np.ndarray | bytes) -> bool:
    """Whether two rows hold the same numbers; a NaN is a NaN whatever its bits."""
    if bytes(one) == bytes(other):
        return True
    a, b = (transition.read_row(kind.layout, row) for row in (one, other))
    return all(
        x.hex() == y.hex() or x != x != y != y if isinstance(x, float) else _single(x, y)
        for x, y in zip(a, b, strict=True)
    )


def _single(x: object, y: object) -> bool:
    same = np.asarray(x).tobytes() == np.asarray(y).tobytes()
    return same or (isinstance(x, np.float32) and bool(np.isnan(x) and np.isnan(y)))


def differing(seed: int, ticks: int, options: dict, wild: float) -> tuple[int, set[int]]:
    """Ticks in which anything differs, what is remembered included, and the run levels that were
    passed.
    """
    compiled, interpreted = (
        ControlSoftware(**options, arithmetic=way) for way in ("compiled", "interpreted")
    )
    drive, count, levels = Drive(seed, compiled, wild), 0, set()
    for cycle in drive.cycles(ticks):
        arguments = cycle.encoders, cycle.packet, cycle.pins, cycle.read_ok
        output, other = compiled.step(*arguments), interpreted.step(*arguments)
        drive.obey(output.dac)
        levels.add(output.output_pins & 3)
        same = (output.dac, output.output_pins) == (other.dac, other.output_pins)
        same = same and same_bits(output._kind, output._row, other._row)
        count += not (
            same and same_bits(compiled.code.kinds["state"], compiled._state, interpreted._state)
        )
    return count, levels


def test_no_tick_differs():
    count, levels = differing(1, 200, *PARTS["raven2, third"])
    assert count == 0
    assert levels == {0, 1, 2, 3}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("precision", "arms"), [(CAMPAIGN, ("gold",)), (REFERENCE, ("gold", "green"))]
)
def test_no_tick_of_other_widths_and_arms_differs(precision, arms):
    assert differing(2, 300, {"precision": precision, "arms": arms}, 0.02)[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("part", list(PARTS))
def test_none_of_800_ticks_differs(part):
    count, levels = differing(list(PARTS).index(part), 800, *PARTS[part])
    assert count == 0
    assert len(levels) == (1 if part.startswith("fork2015") else 4)
