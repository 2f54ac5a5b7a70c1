"""A log of a virtual robot with other friction: its replay, and the friction found again."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.calibration import drawing, parameters, replay, tables
from ravenjax.calibration.calibrate import ROTOR, Calibration, LoggedRobot
from ravenjax.calibration.fit import Fit
from ravenjax.calibration.log import JointLog
from ravenjax.calibration.parameters import Unknown
from ravenjax.calibration.sampling import ReplayEffort
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

SETUP = RavenSetup(software="fork2015", arms=("gold",), tools=("r_grasper",))
FRICTION = tuple(Unknown("motor_friction", ("actuators.coulomb",), j, 1.0, True) for j in (0, 1, 3))


def logged(hidden: np.ndarray, cycles: int = 6000) -> LoggedRobot:
    """The robot that is moved by `hidden` spreads, along slow sines of all joints."""
    seconds = np.arange(cycles)[:, None] * 1e-3
    middle = np.array([0.53, 1.57, 0.40, -0.36, 0.40, 0.05, 0.05])
    sweep = np.array([0.10, 0.10, 0.008, 0.30, 0.25, 0.25, 0.25])
    rate = np.array([0.31, 0.43, 0.37, 0.29, 0.41, 0.34, 0.47])
    desired = middle + sweep * np.sin(2.0 * np.pi * rate * seconds)
    base = robot.params(SETUP, "gold", "power_consistent")
    run = replay.replay(SETUP, "gold", replay.RAVEN2)
    steps, first, rows = (jnp.asarray(x, "float32") for x in (hidden, desired[0], desired))
    joints = jax.jit(lambda s, f, d: run(parameters.apply(base, FRICTION, s), f, d))(steps, first, rows)
    measured = np.asarray(joints, np.float64)[4::5]
    return LoggedRobot(JointLog(desired[0], desired, measured, np.arange(4, cycles, 5)), SETUP, "gold", replay.RAVEN2)


@pytest.mark.slow
def test_hidden_friction_is_found_and_predicts_the_rest() -> None:
    hidden = np.array([0.5, -0.4, 0.3])
    one = logged(hidden)
    base = robot.params(SETUP, "gold", "power_consistent")
    calibrated = one.calibrated(base, FRICTION)
    np.testing.assert_allclose(calibrated.fit.steps, hidden, atol=0.05)
    np.testing.assert_allclose(calibrated.after, calibrated.before * np.exp(hidden), rtol=0.05)
    assert (calibrated.told < 0.1).all()
    after = parameters.apply(base, FRICTION, jnp.asarray(calibrated.fit.steps))
    log, before, found, rotor = one.judged(one.halves[1], {"before": base, "after": after})
    assert rotor.model == ROTOR
    assert (found.residual[[0, 1, 3]] < 0.2 * before.residual[[0, 1, 3]]).all()
    np.testing.assert_allclose(found.following, log.following, rtol=0.02)
    assert (rotor.following < log.following).all() and (rotor.residual > found.residual).all()


def test_unknowns_move_what_they_name() -> None:
    base = robot.params(SETUP, "gold", "power_consistent")
    wanted = (
        Unknown("dry_friction", ("link_coulomb", "actuators.viscous"), 2, 0.5, True),
        Unknown("offset", ("actuators.bias",), 0, 0.02, False),
    )
    moved = parameters.apply(base, wanted, jnp.array([2.0, -1.0]))
    assert float(moved.link_coulomb[2]) == pytest.approx(float(base.link_coulomb[2]) * np.e, rel=1e-6)
    assert float(moved.actuators.bias[0]) == pytest.approx(float(base.actuators.bias[0]) - 0.02, rel=1e-6)
    assert float(moved.actuators.viscous[2]) == pytest.approx(float(base.actuators.viscous[2]) * np.e, rel=1e-6)
    assert moved.actuators.coulomb == base.actuators.coulomb
    np.testing.assert_allclose(parameters.before(base, wanted), [base.link_coulomb[2], base.actuators.bias[0]])
    assert wanted[0].path == "dry_friction.insertion"


def fitted(covariance: np.ndarray, steps: np.ndarray) -> Calibration:
    """Without a replay."""
    fit = Fit(steps, covariance, np.ones(7), np.ones(7), ())
    return Calibration(FRICTION, np.array([0.02, 0.08, 0.03]), fit, ReplayEffort(0, 0.0))


def test_intervals_are_of_the_belief_after() -> None:
    calibrated = fitted(np.diag([0.01, 0.04, 1.0]), np.array([0.5, 0.0, 0.0]))
    low, high = calibrated.interval
    np.testing.assert_allclose(low, [0.02, 0.08, 0.03] * np.exp([0.5 - 0.16449, -0.32898, -1.6449]), rtol=1e-5)
    np.testing.assert_allclose(low * high, calibrated.after**2, rtol=1e-5)
    inside = (np.exp(calibrated.draws(20_000)) * calibrated.before > low) & (
        np.exp(calibrated.draws(20_000)) * calibrated.before < high
    )
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.01)


def test_what_a_log_tells_only_together_is_named() -> None:
    covariance = np.array([[0.04, 0.0, -0.09], [0.0, 0.01, 0.01], [-0.09, 0.01, 0.25]])
    (pair,) = fitted(covariance, np.zeros(3)).confounded
    assert pair == ("motor_friction.shoulder", "motor_friction.tool_roll", pytest.approx(-0.9))


def test_the_table_tells_value_interval_and_what_is_left() -> None:
    rows = tables.parameters("", fitted(np.diag([0.01, 0.04, 1.0]), np.zeros(3))).cells
    assert rows[0] == ("motor_friction.shoulder", "0.02", "0.02", "0.017", "0.0236", "0.10")
    assert rows[2][-1] == "1.00 (not told)"


def test_pictures_are_written(tmp_path) -> None:
    drawing.intervals(tmp_path / "a.svg", fitted(np.diag([0.01, 0.04, 1.0]), np.zeros(3)))
    log = JointLog(np.zeros(7), np.zeros((2000, 7)), np.full((400, 7), 0.01), np.arange(4, 2000, 5))
    drawing.errors(tmp_path / "b.svg", log, np.full((400, 7), 0.02), 1000)
    for name in ("a.svg", "b.svg"):
        assert (tmp_path / name).read_text().rstrip().endswith("</svg>")
