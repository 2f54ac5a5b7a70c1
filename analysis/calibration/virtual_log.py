"""Makes logs of virtual robots with known parameters, to test `ravenjax calibrate`."""

from collections.abc import Sequence

import numpy as np

from ravenjax.analyses.calibration import parameters, position_loop, replays
from ravenjax.analyses.calibration.calibrate import LoggedRobot
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.analyses.calibration.parameters import Unknown
from ravenjax.analyses.calibration.position_loop import LoopParams
from ravenjax.robots.raven2.setup import RavenSetup

SETUP = RavenSetup(software="fork2015", arms=("gold",), tools=("r_grasper",))
PERIOD_MS = 5
MIDDLE = np.array([0.53, 1.57, 0.40, -0.36, 0.40, 0.05, 0.05])
SWEEP = np.array([0.10, 0.10, 0.008, 0.30, 0.25, 0.25, 0.25])
RATE_HZ = np.array([0.31, 0.43, 0.37, 0.29, 0.41, 0.34, 0.47])


def swept(cycles: int) -> np.ndarray:
    """Return desired joints [cycles, 7] along slow sines, rad and m."""
    return MIDDLE + SWEEP * np.sin(2.0 * np.pi * RATE_HZ * np.arange(cycles)[:, None] * 1e-3)


def recorded(
    base: LoopParams, wanted: Sequence[Unknown], steps: np.ndarray, desired: np.ndarray
) -> LoggedRobot:
    """Return a log of the robot to which `steps` [k] (spreads) move `base`, with desired joints
    `desired` [T, 7], sampled every PERIOD_MS.
    """
    cycles = np.arange(PERIOD_MS - 1, len(desired), PERIOD_MS)
    empty = JointLog(
        desired[0], desired, np.full((len(cycles), position_loop.JOINTS), np.nan), cycles
    )
    setup = replays.setup_of(SETUP, "gold", position_loop.RAVEN2, wanted)
    joints = replays.replay_robots(setup, [parameters.apply_steps(base, wanted, steps)], empty)[0]
    return LoggedRobot(empty._replace(measured=joints), SETUP, "gold", position_loop.RAVEN2)
