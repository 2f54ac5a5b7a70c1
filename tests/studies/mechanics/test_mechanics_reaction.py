"""The share of the links' load that a motor carries, found in virtual robots that have one law
or the other.
"""

import jax
import numpy as np
import pytest

from ravenjax.robots.raven2.geometry import transmission
from studies import mechanics
from studies.dsn16 import recording


@pytest.mark.slow
@pytest.mark.parametrize(("law", "ratio"), [("power_consistent", 12.25), ("traj3", 1.0)])
def test_the_regression_tells_the_two_laws_apart(law, ratio) -> None:
    seconds = np.arange(8000)[:, None] * 1e-3
    joints = np.array([0.5, 1.55, 0.40]) + np.array([0.25, 0.20, 0.02]) * np.sin(
        2.0 * np.pi * np.array([0.6, 0.8, 0.7]) * seconds
    )
    motors = _motors(joints)
    with jax.enable_x64(True):
        run = recording.closed_loop(motors, motors[0], np.zeros(3), law)
        angle, dac = run["mpos"][:, :3], run["dac"][:, :3].astype(float)
        log = recording.JointRecording(angle[:-1], run["mvel"][1:, :3], dac[1:])
        shoulder = mechanics.of_recording(log)[0]
    assert shoulder.scale[1] - 0.1 * ratio < ratio < shoulder.scale[2] + 0.1 * ratio
    assert abs(shoulder.scale[0] - ratio) < 2.0


def _motors(joints: np.ndarray) -> np.ndarray:
    """Motor angles of joints 1-3, [T, 3]."""
    matrix = np.array(transmission.motor_matrix("gold", "r_grasper", "fork2015"))[:3, :3]
    return joints @ matrix.T


def test_a_load_that_is_there_is_predicted_by_the_model_that_has_it(monkeypatch) -> None:
    """Torque made with 12.25 times the load: exact by statics and where it is fitted, and by no
    other model.
    """
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(400, 5))
    columns[:, 3], columns[:, 4] = np.sign(columns[:, 2]), 1.0
    torque = columns @ np.array((2e-4, transmission.GP42, 1e-3, 0.05, 0.01))
    joint = mechanics._Joint(columns, torque, np.arange(400) / 400)
    monkeypatch.setattr(mechanics, "_moving", lambda log: [joint] * 3)
    log = recording.JointRecording(*(np.zeros((400, 3)) for _ in range(3)))
    largest = {
        model: np.array([one.max() for one in errors])
        for model, errors in mechanics.held_out(log).items()
    }
    rotor, authors, statics = mechanics.COMPARED
    exact = {statics, "rotor with friction and a fitted load"}
    assert set(largest) == set(mechanics.MODELS) and rotor in largest and authors in largest
    for model, error in largest.items():
        assert (error < 1e-9).all() == (model in exact), model
