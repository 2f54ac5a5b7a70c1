"""The virtual robot alone: the tick's own behind the USB boards, and a robot of its own to
whoever drives it.
"""

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.errors import UserError
from ravenjax.numbers.lazy import jax

HOME = np.deg2rad([30, 90, 0, 0, 0, 45, 45])
HOME[2] = 0.4


def test_it_moves_as_the_robot_of_a_campaign():
    """Engines fuse multiply-adds, the robot alone does not: a count or so in 1.5 s of motion of
    tens of thousands.
    """
    campaign = {"name": "alone", "duration_s": 1.5, "arms": ["gold", "green"]}
    config = rj.load_campaign({"campaign": campaign, "group": [{"name": "no fault"}]})
    trace, start = rj.simulate(config, 0), plan.make_plan(config).program.params.start
    robot = rj.VirtualRobot(jpos=np.array(start), runlevel=int(trace.plc_runlevel[0]))
    encoders, levels, tips = [], [], []
    for dac, pins in zip(trace.dac_cnt.values, trace.pins_out.values, strict=True):
        reading = robot.step(dac, int(pins))
        encoders.append(reading.encoders)
        levels.append(int(reading.signals.runlevel))
        tips.append(reading.signals.tip)
    # Of the tick before: software reads before the robot moves.
    there = trace.enc_val_cnt.values[1:]
    travel = np.ptp(there, axis=0)
    assert travel.max() > 5000
    apart = np.abs(np.array(encoders)[:-1] - there)
    assert apart.max() <= 3
    assert levels == trace.plc_runlevel.values.tolist()
    np.testing.assert_allclose(np.array(tips, float), trace.tip.values, atol=2e-6)


def test_its_state_is_all_that_it_remembers():
    one, other = rj.VirtualRobot(), rj.VirtualRobot()
    commands = np.random.default_rng(3).integers(-3000, 3000, (200, 2, 7))
    for dac in commands:
        last = one.step(dac, 0b10000)
    for dac in commands:
        again = other.step(dac, 0b10000)
    assert jax.tree.leaves(last.signals) == jax.tree.leaves(again.signals)


WRONG = [
    (lambda: rj.VirtualRobot(arms=["red"]), "arm is 'red', expected one of gold, green"),
    (lambda: rj.VirtualRobot(runlevel=7), "runlevel is 7, expected a whole number 0..3"),
    (lambda: rj.VirtualRobot(jpos=[[0] * 7]), r"jpos has shape \(1, 7\)"),
    (
        lambda: rj.VirtualRobot().step(np.zeros((2, 7), int), 256),
        "output_pins is 256, expected a whole number 0..255",
    ),
]


@pytest.mark.parametrize(("call", "words"), WRONG)
def test_what_is_wrong_is_named(call, words):
    with pytest.raises(UserError, match=words):
        call()
