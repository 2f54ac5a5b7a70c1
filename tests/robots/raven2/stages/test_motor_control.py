"""Gains, couplings and what holds when."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.numbers.setup import ORIGINAL
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import motor_control as control

SETUP = RavenSetup(precision=ORIGINAL)
FORK = RavenSetup(software="fork2015", tools=("r_grasper_B",), precision=ORIGINAL)
HOME = Vec(map(np.float32, HOME_JPOS))


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def torques(setup, arm, active=True, pedal_down=True, error=0.1, speed=2.0, state=None):
    state = state or control.init(setup, arm, "r_grasper", HOME_JPOS)
    mpos = Vec.full(7, np.float32(10.0))
    given = (HOME, mpos, Vec.full(7, np.float32(speed)))
    params = control.params(setup, arm)
    return control.torques(
        setup,
        arm,
        params,
        state,
        np.bool_(active),
        np.bool_(pedal_down),
        mpos + np.float32(error),
        given,
    )


def floats(vec):
    return [float(x) for x in vec]


def test_gains_act_as_in_the_parameter_file():
    lift = [-0.012388688657, -0.043105463220, 0.012064941548]
    law = [0.03 - 0.016, 0.03 - 0.016, 0.015 - 0.024, 0.009 - 0.002, 0.005, 0.005, 0.005]
    integral = 0.1 * 0.001 * 0.05
    expected = [law[i] + (lift[i] if i < 3 else integral) for i in range(7)]
    assert floats(torques(SETUP, "gold").tau_d) == pytest.approx(expected, abs=1e-6)
    assert float(torques(SETUP, "green").tau_d[2]) == pytest.approx(
        0.015 - 0.02 + lift[2], abs=1e-6
    )


def test_the_fork_has_no_gravity_torque_and_softer_jaws():
    state = torques(FORK, "gold")
    assert floats(state.tau_g) == [0.0] * 3
    assert floats(state.tau_d) == pytest.approx(
        [0.014, 0.014, -0.009, 0.007005, 0.005005, 0.002, 0.002], abs=1e-6
    )


def test_in_pedal_up_only_gravity_acts_and_nothing_integrates():
    state = torques(SETUP, "gold", pedal_down=False)
    assert floats(state.tau_d) == pytest.approx([*floats(state.tau_g), 0, 0, 0, 0])
    assert floats(state.integral) == [0.0] * 7


def test_there_is_no_integral_clamp():
    state = None
    for _ in range(50):
        state = torques(SETUP, "gold", error=1000.0, state=state)
    assert float(state.integral[6]) == pytest.approx(50.0, rel=1e-5)


@pytest.mark.parametrize("setup", [SETUP, FORK], ids=["raven2", "fork2015"])
@pytest.mark.parametrize("arm", ["gold", "green"])
@pytest.mark.parametrize("tool", ["r_grasper", "large_needle"])
def test_targets_are_those_of_the_transmission(setup, arm, tool):
    expected = transmission.motor_from_joint(arm, tool, HOME_JPOS, software=setup.software)
    targets = control.targets(setup, arm, tool, HOME, Vec(map(np.float32, expected)))
    assert floats(targets) == pytest.approx(list(expected), rel=1e-6)
    assert floats(control.init(setup, arm, tool, HOME_JPOS).mpos_d) == pytest.approx(
        list(expected), rel=1e-6
    )
