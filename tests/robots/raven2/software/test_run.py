"""Many cycles in one call are as many steps; what is wrong is named and nothing has happened."""

import jax
import numpy as np
import pytest
from drives import Drive

from ravenjax.errors import UserError
from ravenjax.robots.raven2.software.control_software import ControlSoftware


@pytest.mark.parametrize(
    "arithmetic", ["compiled", pytest.param("interpreted", marks=pytest.mark.slow)]
)
def test_a_run_is_as_many_steps(arithmetic):
    one = ControlSoftware()
    drive, cycles, steps = Drive(7, one, 0.02), [], []
    for cycle in drive.cycles(200):
        cycles.append(cycle)
        steps.append(one.step(cycle.encoders, cycle.packet, cycle.pins, cycle.read_ok))
        drive.obey(steps[-1].dac)
    assert any(isinstance(cycle.packet, list) and len(cycle.packet) > 1 for cycle in cycles)
    other = ControlSoftware(arithmetic=arithmetic)
    parts = [slice(0, 1), slice(1, 150), slice(150, 150), slice(150, 200)]
    for part in parts:
        run = other.run(
            np.array([cycle.encoders for cycle in cycles[part]], np.int32).reshape(-1, 2, 7),
            [cycle.packet for cycle in cycles[part]],
            np.array([cycle.pins for cycle in cycles[part]], int).reshape(-1, 2),
            np.array([cycle.read_ok for cycle in cycles[part]], bool).reshape(-1, 2),
        )
        assert run.dac.tolist() == [[list(arm) for arm in step.dac] for step in steps[part]]
        assert run.output_pins.tolist() == [step.output_pins for step in steps[part]]
        columns, rows = (
            jax.tree.leaves(run.signals),
            [jax.tree.leaves(step.signals) for step in steps[part]],
        )
        for k, column in enumerate(columns):
            np.testing.assert_array_equal(column, np.array([row[k] for row in rows], column.dtype))
    assert repr(one.state) == repr(other.state)  # a NaN has no equal


def test_one_number_stands_for_all_cycles_and_arms():
    encoders = np.zeros((30, 2, 7), np.int16)
    plain = ControlSoftware().run(encoders, pins=64)
    for pins in ([64] * 30, [[64, 64]] * 30, np.full(30, 64, np.uint8)):
        run = ControlSoftware().run(encoders, None, pins, True)
        assert run.output_pins.tolist() == plain.output_pins.tolist()
    assert plain.signals.runlevel.tolist() == [0] * 3 + [1] * 27


CYCLES = {"encoders": np.zeros((3, 2, 7), int)}
WRONG = [
    ({"encoders": np.zeros((3, 7), int)}, ("encoders has shape (3, 7)", "[.., 2, 7]")),
    ({"encoders": np.full((3, 2, 7), 2**31)}, ("encoders[0][0][0] (shoulder) is 2147483648",)),
    ({"packets": [None]}, ("packets has 1 entries", "one entry per cycle (3)")),
    ({"pins": [0, 0, -1]}, ("pins[2] is -1",)),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG, ids=[words[0] for _, words in WRONG])
def test_a_wrong_argument_is_named_and_nothing_has_happened(arguments, words):
    software, other = ControlSoftware(), ControlSoftware()
    with pytest.raises(UserError) as error:
        software.run(**{**CYCLES, **arguments})
    for word in words:
        assert word in str(error.value), str(error.value)
    assert software.state == other.state
