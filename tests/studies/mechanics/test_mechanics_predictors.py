"""The seven joints' predictions: speeds, integrals and starts, of logs that the virtual robot
made itself.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.analyses.calibration import position_loop, replay
from ravenjax.analyses.calibration.calibrate import LoggedRobot
from ravenjax.analyses.calibration.log import JointLog
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from studies.dsn16.recording import horizons
from studies.mechanics import predictors, recordings

CYCLES = 1500


def logged(measured: np.ndarray, desired: np.ndarray) -> LoggedRobot:
    """Every fifth cycle of joints [T, 7] as a log."""
    cycles = np.arange(4, len(desired), 5)
    return LoggedRobot(
        JointLog(desired[0], desired, measured[cycles], cycles),
        recordings.SETUP,
        "gold",
        position_loop.RAVEN2,
    )


def wave() -> np.ndarray:
    """Desired joints [CYCLES, 7] that sway slowly, each by a few degrees or 2 mm."""
    seconds = np.arange(CYCLES)[:, None] * 1e-3
    size = np.array((0.08, 0.08, 0.002, 0.1, 0.1, 0.1, 0.1))
    return np.array([*HOME_JPOS]) + size * (1.0 - np.cos(2.0 * np.pi * 0.5 * seconds))


def test_the_speed_of_a_line_is_its_slope_and_knows_no_later_row() -> None:
    slope = np.arange(1.0, 8.0)
    line = np.arange(40)[:, None] * 4.94e-3 * slope
    np.testing.assert_allclose(
        predictors.speeds(line, 4.94)[predictors.SLOPE_ROWS - 1 :], np.tile(slope, (36, 1))
    )
    later = line.copy()
    later[21:] += 1.0
    np.testing.assert_array_equal(
        predictors.speeds(later, 4.94)[:21], predictors.speeds(line, 4.94)[:21]
    )


def test_of_a_log_that_is_its_own_replay_the_integral_is_that_of_the_errors() -> None:
    desired = wave()
    course = np.vstack([desired[:1], desired[:-1]])  # a robot that is one cycle late
    one = logged(course, desired)
    course = np.stack(
        [np.interp(np.arange(CYCLES) + 1, one.log.cycles + 1, c) for c in one.log.measured.T],
        axis=1,
    )
    errors = predictors._motor_errors(one, np.vstack([one.log.start, course[:-1]]))
    expected = (
        (np.cumsum(errors, axis=0) - errors) * 1e-3 * (np.array([*position_loop.RAVEN2.ki]) > 0.0)
    )
    np.testing.assert_allclose(predictors.integrals(one, course)[10:], expected[10:], atol=1e-9)


@pytest.mark.slow
def test_what_made_a_log_predicts_it_better_than_every_null_model() -> None:
    desired = wave()
    true, *_ = horizons.models(recordings.SETUP, "gold")
    run = replay.replay(recordings.SETUP, "gold", position_loop.RAVEN2)
    first, rows = jnp.asarray(desired[0], "float32"), jnp.asarray(desired, "float32")
    one = logged(np.asarray(jax.jit(run)(true.params, first, rows), float), desired)
    half = predictors.second_half(one)
    part = predictors.stretch(one, half, 5.0)
    starts = np.arange(0, 100, 10)
    ahead = {
        model.model: model.ahead(starts, 25)
        for model in (*predictors.of(one, half, 5.0), *horizons.held(part))
    }
    truth = part.angle[starts[:, None] + np.arange(1, 26)]
    error = {name: np.abs(joints - truth).mean(axis=(0, 1)) for name, joints in ahead.items()}
    mine = error.pop(true.name)
    for name, other in error.items():
        if name.startswith("null"):
            assert (mine[:3] < other[:3]).all(), name
    assert (mine < 0.25 * error[horizons.HELD_POSITION]).all()
