"""Kinematic errors: first order by the Jacobian, reports that do not know them, and what drops
out without them.
"""

import dataclasses

import jax
import numpy as np
import pytest
from plant_runs import N, setup

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import kinematic_errors, robot
from ravenjax.robots.raven2.plant.coupling import arm_coupling
from ravenjax.robots.raven2.plant.kinematic_errors import KinematicErrors
from studies.healthy_robot import tip_error

START = Vec((0.6, 1.4, 0.37, 0.3, 0.2, 0.7, 0.9))
EXACT = kinematic_errors.no_errors()


def with_errors(**fields) -> robot.PlantParams:
    """Weightless, so that no cable is stretched and every difference is an error's."""
    still = replace(robot.params(setup(), "gold", "power_consistent"), gravity=Vec.full(3, 0.0))
    return replace(still, kinematic_errors=replace(EXACT, **fields))


def at_start(one: robot.PlantParams, start=START) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints that the software computes from the encoders, true joints, true tip."""
    with jax.enable_x64(True):
        state = robot.init(setup(), "gold", one, start)
        out = robot.observe_robot(setup(), "gold", one, state)
        signs = transmission.encoder_signs("gold", "r_grasper")
        mpos = Vec(
            s * float(c) * transmission.ENCODER_RAD for s, c in zip(signs, out.enc_val, strict=True)
        )
        reported = transmission.joint_from_motor("gold", "r_grasper", mpos)
        (tip,) = robot.true_tips(setup(), (one,), (state,), (out,))
        return np.array(reported, float), np.array(out.jpos, float), np.array(tip, float)


@pytest.mark.parametrize("joint", range(5))
def test_an_offset_moves_the_true_tip_by_its_jacobian_and_the_report_not_at_all(joint) -> None:
    offset = 1e-4
    reported, links, tip = at_start(with_errors())
    reported_too, moved_links, moved_tip = at_start(
        with_errors(joint_offset=Vec.full(7, 0.0).replace(joint, offset))
    )
    with jax.enable_x64(True):
        column = np.array(kinematics.tip_jacobian("gold", START), float)[:3, joint]
    assert np.array_equal(reported, reported_too)
    np.testing.assert_allclose(moved_links - links, offset * np.eye(7)[joint], atol=1e-12)
    np.testing.assert_allclose(moved_tip - tip, offset * column, atol=2e-8)
    assert np.linalg.norm(offset * column) > 1e-7


def test_a_larger_drum_moves_its_joint_further_from_home_by_its_share() -> None:
    error = Vec.full(7, 0.0).replace(1, 0.02)
    reported, links, _ = at_start(with_errors(ratio_error=error))
    assert links[1] - HOME_JPOS[1] == pytest.approx(1.02 * (START[1] - HOME_JPOS[1]), abs=1e-12)
    assert reported[1] == pytest.approx(START[1], abs=1e-4)  # a count of the encoder
    _, at_home, _ = at_start(with_errors(ratio_error=error), HOME_JPOS)
    np.testing.assert_allclose(at_home, HOME_JPOS, atol=1e-12)


def test_a_built_coupling_is_the_product_of_its_matrices() -> None:
    rng = np.random.default_rng(3)
    drawn, gain = (
        arm_coupling("gold", "large_needle", "raven2"),
        Vec(1.0 + rng.uniform(-0.1, 0.1, N)),
    )
    matrix = np.array(transmission.motor_matrix("gold", "large_needle")) / np.array(gain)
    one, x = dataclasses.replace(drawn, gain=gain), rng.normal(size=N)
    np.testing.assert_allclose(one.to_motors(Vec(x)), matrix @ x, rtol=1e-12)
    np.testing.assert_allclose(one.to_joints(Vec(x)), np.linalg.solve(matrix, x), rtol=1e-9)
    np.testing.assert_allclose(one.joint_loads(Vec(x)), matrix.T @ x, rtol=1e-9)
    np.testing.assert_allclose(one.motor_torques(Vec(x)), np.linalg.solve(matrix.T, x), rtol=1e-9)
    weights = rng.uniform(0.5, 2.0, N)
    lower = np.tril(matrix.T @ np.diag(weights) @ matrix)
    np.testing.assert_allclose(
        np.array(one.congruence(Vec(weights)), float), lower, rtol=1e-9, atol=1e-9
    )


def test_registration_is_the_rigid_motion_that_another_method_finds() -> None:
    """Beside the singular value decomposition of Kabsch, for errors as large as a campaign
    draws.
    """
    rng = np.random.default_rng(4)
    with jax.enable_x64(True):
        for _ in range(3):
            errors = _drawn(rng)
            true = [
                kinematic_errors.true_tip(
                    "gold", errors, None, kinematic_errors.true_joints(errors, pose)
                )
                for pose in kinematic_errors.POSES
            ]
            frame = kinematic_errors.fit_registration("gold", true)
            ours = np.array(
                [
                    [float(x) for x in kinematic_errors.in_registered_frame(frame, point)]
                    for point in true
                ]
            )
            reported = np.array(
                [kinematics.forward_pose("gold", pose).position for pose in kinematic_errors.POSES],
                float,
            )
            left = np.square(ours - reported).sum()
            points = np.array(true, float)
            best = _kabsch(points, reported)
            assert left == pytest.approx(np.square(best - reported).sum(), rel=1e-6)


def _drawn(rng: np.random.Generator) -> KinematicErrors:
    with jax.enable_x64(True):
        return tip_error.with_values(
            jax.numpy.asarray(rng.normal(size=len(tip_error.SPREAD)) * tip_error.SPREAD)
        )


def _kabsch(points: np.ndarray, onto: np.ndarray) -> np.ndarray:
    far = tip_error.FAR_M
    try:
        tip_error.FAR_M = 1e9  # plain least squares
        return tip_error.fit_motion(points, onto)(points)
    finally:
        tip_error.FAR_M = far
