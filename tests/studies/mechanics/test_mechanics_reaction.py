"""The share of the links' load that a motor carries, found in virtual robots that have one law or the other."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.robots.raven2.geometry import transmission
from ravenjax.studies.dsn16.recording import closed_loop
from ravenjax.studies.mechanics import reaction


@pytest.mark.slow
@pytest.mark.parametrize(("law", "ratio"), [("power_consistent", 12.25), ("traj3", 1.0)])
def test_the_regression_tells_the_two_laws_apart(law, ratio) -> None:
    seconds = np.arange(8000)[:, None] * 1e-3
    joints = np.array([0.5, 1.55, 0.40]) + np.array([0.25, 0.20, 0.02]) * np.sin(
        2.0 * np.pi * np.array([0.6, 0.8, 0.7]) * seconds
    )
    motors = _motors(joints)
    with jax.enable_x64(True):
        run = closed_loop.closed_loop(motors, motors[0], np.zeros(3), law)
        angle, dac = run["mpos"][:, :3], run["dac"][:, :3].astype(float)
        log = closed_loop.JointRecording(angle[:-1], run["mvel"][1:, :3], dac[1:])
        shoulder = reaction.of_recording(log)[0]
    assert shoulder.scale[1] - 0.1 * ratio < ratio < shoulder.scale[2] + 0.1 * ratio
    assert abs(shoulder.scale[0] - ratio) < 2.0


def _motors(joints: np.ndarray) -> np.ndarray:
    """Motor angles of joints 1-3, [T, 3]."""
    matrix = np.array(transmission.motor_matrix("gold", "r_grasper", "fork2015"))[:3, :3]
    return joints @ matrix.T
