"""A log of a virtual robot with other friction: its replay, and the friction found again."""

import itertools

import numpy as np
import pandas as pd
import pytest
import virtual_log
from scipy.stats import binom

import ravenjax as rj
from ravenjax.analyses.calibration import joint_log, parameters, position_loop
from ravenjax.analyses.calibration.calibrate import NORMAL_90, ROTOR, Calibration, LoggedRobot
from ravenjax.analyses.calibration.fit import MIN_NOISE, Fit
from ravenjax.analyses.calibration.parameters import Unknown
from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

FRICTION = tuple(
    Unknown("motor_friction", ("plant.actuators.coulomb",), j, 1.0, True) for j in (0, 1, 3)
)
PLANT = robot.params(virtual_log.SETUP, "gold")


@pytest.mark.slow
def test_hidden_friction_is_found_and_predicts_the_rest() -> None:
    hidden = np.array([0.5, -0.4, 0.3])
    one = virtual_log.recorded(
        position_loop.params(PLANT), FRICTION, hidden, virtual_log.swept(6000)
    )
    calibrated = one.calibrated(PLANT, FRICTION)
    np.testing.assert_allclose(calibrated.fit.steps, hidden, atol=0.05)
    np.testing.assert_allclose(calibrated.after, calibrated.before * np.exp(hidden), rtol=0.05)
    assert (calibrated.spread_ratio < 0.1).all()
    log, before, found, rotor = one.following_errors(
        one.halves[1], {"before": calibrated.base, "after": calibrated.robot}
    )
    assert rotor.model == ROTOR
    assert (found.residual[[0, 1, 3]] < 0.2 * before.residual[[0, 1, 3]]).all()
    np.testing.assert_allclose(found.following, log.following, rtol=0.02)
    assert (rotor.following < log.following).all() and (rotor.residual > found.residual).all()


@pytest.mark.slow
def test_nine_of_ten_hidden_values_of_every_kind_are_inside_their_intervals() -> None:
    """Two logs of the twenty that docs/how-to/calibrate.md counts."""
    wanted = parameters.select_unknowns(range(7))
    base, desired = parameters.prior_robot(PLANT, wanted), virtual_log.swept(10_000)
    inside = []
    for seed in (0, 1):
        hidden = np.random.default_rng(seed).standard_normal(len(wanted))
        one = virtual_log.recorded(base, wanted, hidden, desired).calibrated(PLANT, wanted)
        inside.extend(np.abs(one.fit.steps - hidden) <= NORMAL_90 * one.spread_ratio)
        assert (one.spread_ratio[:7] < 0.2).all() and one.spread_ratio.max() < 1.001
    assert sum(inside) >= binom.ppf(0.025, len(inside), 0.9)


@pytest.mark.slow
def test_a_log_of_the_full_simulator_is_replayed_to_a_count(tmp_path) -> None:
    """Also with gravity compensation, and at an insertion that moves less than its cable gives."""
    campaign = {
        "campaign": {"name": "log", "duration_s": 5.0},
        "operator": {"motion": "suture", "scale": 0.005},
        "parameters": {"plant.friction_scale": 0.7},
        "group": [{"name": "healthy"}],
    }
    run = rj.simulate(campaign).sel(arm="gold")
    assert np.ptp(run["jpos_d"].sel(joint="insertion").values) < 1e-3
    logs = []
    for names in (("jpos_d", "jpos"), ("dac_cnt", "mpos", "mvel")):
        columns = {"time_s": run["time"].values, "runlevel": run["runlevel"].values}
        for name, joint in itertools.product(names, run["joint"].values):
            values = run[name].sel(joint=joint).values.astype(float)
            columns[f"{name.removesuffix('_cnt')}_{joint}"] = values
        pd.DataFrame(columns).to_parquet(tmp_path / "log.parquet")
        logs.append(
            joint_log.read_joint_log(
                tmp_path / "log.parquet", "gold", "r_grasper", "raven2", position_loop.RAVEN2
            )
        )
    by_joints, by_torques = logs
    np.testing.assert_allclose(by_torques.desired[:, :3], by_joints.desired[:, :3], atol=2e-5)
    setup = RavenSetup(software="raven2", arms=("gold",))
    logged = LoggedRobot(by_joints, setup, "gold", position_loop.RAVEN2)
    plant = robot.params(setup, "gold")
    truth = position_loop.params(replace(plant, friction_scale=0.7))
    _, found, _ = logged.following_errors(logged.halves[0], {"truth": truth})
    assert (found.residual < MIN_NOISE).all()
    wanted = parameters.select_unknowns((2,), ("friction", "offsets", "motors", "cables"))
    low, high = logged.calibrated(plant, wanted).interval
    before = parameters.prior_values(position_loop.params(plant), wanted)
    hidden = before * np.where(["friction" in one.name for one in wanted], 0.7, 1.0)
    assert ((low <= hidden) & (hidden <= high)).all()


def test_joints_at_rest_are_named() -> None:
    desired = np.tile(virtual_log.MIDDLE, (4000, 1))
    log = joint_log.JointLog(desired[0], desired, desired, np.arange(4000))
    logged = LoggedRobot(log, virtual_log.SETUP, "gold", position_loop.RAVEN2)
    with pytest.raises(UserError, match=r"no joint moves .*shoulder, .* grasp2"):
        logged.calibrated(PLANT, FRICTION)
    moving = np.where(np.arange(7) != 4, virtual_log.swept(4000), desired)
    log = log._replace(measured=moving)
    assert LoggedRobot(log, virtual_log.SETUP, "gold", position_loop.RAVEN2).at_rest == ["wrist"]


def fitted(covariance: np.ndarray, steps: np.ndarray) -> Calibration:
    """Without a replay."""
    fit = Fit(steps, covariance)
    coulomb = Vec((0.02, 0.08, 0.0, 0.03, 0.0, 0.0, 0.0))
    plant = replace(PLANT, actuators=replace(PLANT.actuators, coulomb=coulomb))
    return Calibration(FRICTION, position_loop.params(plant), fit)


def test_intervals_are_of_the_belief_after() -> None:
    calibrated = fitted(np.diag([0.01, 0.04, 1.0]), np.array([0.5, 0.0, 0.0]))
    low, high = calibrated.interval
    np.testing.assert_allclose(
        low, [0.02, 0.08, 0.03] * np.exp([0.5 - 0.16449, -0.32898, -1.6449]), rtol=1e-5
    )
    np.testing.assert_allclose(low * high, calibrated.after**2, rtol=1e-5)
    inside = (np.exp(calibrated.draws(20_000)) * calibrated.before > low) & (
        np.exp(calibrated.draws(20_000)) * calibrated.before < high
    )
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.01)
