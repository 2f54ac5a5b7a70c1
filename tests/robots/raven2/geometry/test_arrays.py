import jax
import numpy as np
import pytest

from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import arrays, gravity, transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS

HOME = np.array(HOME_JPOS)
JPOS = HOME + 0.05 * np.random.default_rng(0).normal(size=(2, 3, 7))


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_any_leading_axes_there_and_back(arm):
    position, rotation = arrays.forward_kinematics(JPOS, arm)
    assert position.shape == (2, 3, 3) and rotation.shape == (2, 3, 3, 3)
    assert position.dtype == rotation.dtype == np.float64
    jpos_d, status = arrays.inverse_kinematics(
        position, rotation, JPOS[..., 5] + JPOS[..., 6], JPOS, arm
    )
    assert status.shape == (2, 3) and status.dtype.kind == "i" and (status == 0).all()
    np.testing.assert_allclose(jpos_d, JPOS, atol=1e-9)
    single = arrays.forward_kinematics(JPOS[1, 2], arm)
    np.testing.assert_array_equal(single[0], position[1, 2])
    assert single[1].shape == (3, 3)


def test_arguments_broadcast():
    position, rotation = arrays.forward_kinematics(HOME + 0.1 * (JPOS - HOME), "gold")
    jpos_d, status = arrays.inverse_kinematics(position, rotation, 1.5, HOME, "gold")
    assert jpos_d.shape == (2, 3, 7) and (status == 0).all()
    np.testing.assert_allclose(jpos_d[..., 5] + jpos_d[..., 6], 1.5)


def test_rejected_poses_are_nan():
    position, rotation = arrays.forward_kinematics(HOME, "gold")
    far = HOME + np.array([0, 0, 0.05, 0, 0, 0, 0])
    jpos_d, status = arrays.inverse_kinematics(
        position, rotation, 1.5, np.stack([far, HOME]), "gold"
    )
    assert status.tolist() == [-1, 0]
    assert np.isnan(jpos_d[0]).all() and np.isfinite(jpos_d[1]).all()


@pytest.mark.parametrize("tool", ["r_grasper", "large_needle"])
def test_transmission_and_gravity(tool):
    mpos = arrays.motor_from_joint(JPOS, "green", tool)
    np.testing.assert_allclose(
        mpos, JPOS @ np.array(transmission.motor_matrix("green", tool)).T, atol=1e-9
    )
    np.testing.assert_allclose(arrays.joint_from_motor(mpos, "green", tool), JPOS, atol=1e-12)
    with jax.enable_x64(True):
        expected = gravity.gravity_torque("green", Vec(JPOS[1, 1]))
    np.testing.assert_allclose(arrays.gravity_torque(JPOS, "green")[1, 1], expected, atol=1e-15)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.zeros(7) + 1j, "got complex128, expected real numbers"),
        (["1"] * 7, "got <U1"),
        ([[0.0] * 7, [0.0] * 6], "is not an array of numbers"),
        (np.ma.masked_array(np.zeros(7), [True] + [False] * 6), "got masked numbers"),
        (np.zeros(8), r"jpos has shape \(8,\), expected"),
        ([np.inf] + [0.0] * 6, r"jpos\[0\] \(shoulder\) is inf"),
    ],
    ids=lambda part: part if isinstance(part, str) else "",
)
def test_what_is_no_real_number_is_refused(value, words):
    with pytest.raises(UserError, match=words):
        arrays.forward_kinematics(value, "gold")


@pytest.mark.parametrize(
    ("rotation", "words"),
    [
        (np.zeros((3, 3)), "not orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), "is a reflection"),
        (np.stack([np.eye(3), np.ones((3, 3))]), r"rotation\[1\] has columns"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation, words):
    with pytest.raises(UserError, match=words):
        arrays.inverse_kinematics(np.zeros(3), rotation, 0.0, HOME, "gold")
