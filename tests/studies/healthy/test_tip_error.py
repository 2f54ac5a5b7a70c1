"""The tip error of drawn arms, and what is fitted of it, on logs of arms whose errors are known."""

import jax
import made_up_camera
import numpy as np
import pytest

from studies.healthy_robot import arm_errors, camera_log, tip_error

NONE = np.zeros(len(tip_error.PATHS))
ELBOW = tip_error.PATHS.index("joint_offset.elbow")


def test_a_drawn_robot_predicts_the_errors_that_a_camera_sees_of_it() -> None:
    values = tip_error.draw(1, seed=5)
    log = made_up_camera.log(values[0])
    predicted, seen = tip_error.predicted(log, values), tip_error.errors_of(log, log.camera)
    for ours, camera in zip(predicted, seen, strict=True):
        np.testing.assert_allclose(ours[0], camera, atol=1e-9)


def test_the_factor_is_that_of_the_middle_robot() -> None:
    """A log of the drawn robot in the middle asks for about the distribution that it was drawn
    from, twice it for 2.
    """
    robots = tip_error.draw(41, seed=1)
    log = made_up_camera.log(NONE)
    middle = np.argsort(np.median(tip_error.predicted(log, robots)[0], axis=1))[20]
    for times in (0.5, 1.0):
        factor = tip_error.factor(made_up_camera.log(times * robots[middle]), robots)
        assert factor == pytest.approx(times, rel=0.1)


@pytest.mark.slow
def test_an_arm_s_own_errors_are_told_from_noise_where_nothing_was_fitted() -> None:
    values = NONE.copy()
    values[ELBOW] = 0.15
    log = made_up_camera.log(values, noise_m=5e-4)
    none, right, wrong = (
        arm_errors.fit(log, parts) for parts in ((), ("joint_offset",), ("ratio_error",))
    )
    medians = [float(np.median(one.left[1])) for one in (none, right, wrong)]
    assert medians[1] < 0.85e-3, "noise alone has a median of 0.77 mm"
    assert min(medians[0], medians[2]) > 1.1 * medians[1]
    assert right.values[ELBOW] == pytest.approx(0.15, abs=0.03)
    own = tip_error.predicted(made_up_camera.log(NONE), values[None])[1]
    assert np.median(right.own[1]) == pytest.approx(np.median(own), rel=0.2)


@pytest.mark.slow
def test_the_recording_is_in_the_software_s_frame(shared_data) -> None:
    """Its joints lie inside their limits, and forward kinematics of them give the reported tip."""
    log = camera_log.read(shared_data(camera_log.FILE)).rows(slice(None, None, 50))
    low, high = np.radians([0, 45, 0, -182, -70]), np.radians([90, 135, 0, 182, 70])
    low[2], high[2] = 0.23, 0.56
    assert ((log.joints[:, :5] > low) & (log.joints[:, :5] < high)).all()
    with jax.enable_x64(True):
        tips = np.asarray(tip_error.true_tips(jax.numpy.zeros(16), jax.numpy.asarray(log.joints)))
    np.testing.assert_allclose(tips, log.reported, atol=1e-8)


@pytest.mark.slow
def test_the_distribution_in_use_is_that_of_the_recording_s_first_half(shared_data) -> None:
    log = camera_log.read(shared_data(camera_log.FILE)).rows(slice(None, None, 60))
    assert tip_error.factor(log, tip_error.draw(500)) == pytest.approx(1.0, abs=0.1)
