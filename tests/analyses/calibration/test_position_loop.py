"""The position loop: a delay of the desired joints."""

import numpy as np
import pytest
import virtual_log

from ravenjax.analyses.calibration import parameters, position_loop, replays
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.numbers.vec import replace
from ravenjax.robots.raven2.plant import robot

BASE = position_loop.params(robot.params(virtual_log.SETUP, "gold"))


@pytest.mark.slow
def test_a_late_setpoint_moves_the_joints_later() -> None:
    """At a steady speed a shift of the setpoint is a shift of what follows it, but for the
    encoders' steps.
    """
    desired = (
        virtual_log.MIDDLE + virtual_log.SWEEP * np.minimum(np.arange(3000) * 1e-3, 3.0)[:, None]
    )
    log = JointLog(desired[0], desired, desired, np.arange(len(desired)))
    delays = parameters.select_unknowns((), ("delays",))
    setup = replays.setup_of(virtual_log.SETUP, "gold", position_loop.RAVEN2, delays)
    robots = [replace(BASE, setpoint_delay=delay) for delay in (0.0, 20.0)]
    at_once, late = replays.replay_robots(setup, robots, log)
    step = virtual_log.SWEEP * 1e-3
    np.testing.assert_allclose((at_once - late)[2000:].mean(axis=0) / step, 20.0, rtol=0.06)
