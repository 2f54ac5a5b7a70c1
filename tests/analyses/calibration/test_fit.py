"""The fit by itself, on predictions with a closed form."""

import numpy as np
import pytest

from ravenjax.analyses.calibration import fit as fitting

ROWS = 400
TIME = np.linspace(0.0, 1.0, ROWS)


def predictor(steps: np.ndarray) -> np.ndarray:
    """Two unknowns: the rate of a decay at joint 0, and an offset at joint 1; five joints do not
    move.
    """
    joints = np.zeros((len(steps), ROWS, 7))
    joints[:, :, 0] = np.exp(-np.exp(steps[:, :1]) * TIME)
    joints[:, :, 1] = steps[:, 1:2]
    return joints


def measured(truth: np.ndarray, noise: float) -> np.ndarray:
    rng = np.random.default_rng(5)
    joints = predictor(truth[None])[0] + rng.normal(0.0, noise, (ROWS, 7))
    joints[:, 2:] = np.nan
    return joints


@pytest.mark.parametrize(("noise", "samples"), [(0.01, ROWS), (1e-6, fitting.ASSUMED_SAMPLES)])
def test_what_a_log_tells_is_found_as_surely_as_least_squares_say(noise, samples) -> None:
    """Errors of less than a count say little, however many rows there are."""
    truth = np.array([0.7, -0.4])
    best = fitting.fit_parameters(predictor, measured(truth, noise), 2)
    slope = np.exp(0.7) * TIME * np.exp(-np.exp(0.7) * TIME)
    smallest = np.maximum(noise, fitting.MIN_NOISE[:2])
    expected = smallest / np.sqrt([samples * (slope**2).mean(), samples])
    deviation = np.sqrt(np.diag(best.covariance))
    np.testing.assert_allclose(deviation, expected, rtol=0.3)
    assert (np.abs(best.steps - truth) < 3.0 * deviation).all()


def test_what_a_log_does_not_tell_stays_as_it_was_believed() -> None:
    best = fitting.fit_parameters(
        lambda steps: predictor(steps)[:, :, [0, 2, 2, 3, 4, 5, 6]],
        measured(np.array([0.7, 0.0]), 0.01),
        2,
    )
    assert best.steps[1] == 0.0 and best.covariance[1, 1] == pytest.approx(1.0)


@pytest.mark.parametrize("truth", [1.6, -1.7])
def test_a_joint_that_sticks_is_left_by_a_longer_step(truth) -> None:
    """Between -1 and 1 nothing moves, as behind too much friction: no slope leads out."""

    def sticking(steps: np.ndarray) -> np.ndarray:
        free = np.sign(steps[:, :1]) * np.maximum(np.abs(steps[:, :1]) - 1.0, 0.0)
        joints = np.zeros((len(steps), ROWS, 7))
        joints[:, :, 0] = free * TIME
        return joints

    measured = sticking(np.array([[truth]]))[0] + np.random.default_rng(2).normal(
        0.0, 0.002, (ROWS, 7)
    )
    measured[:, 1:] = np.nan
    best = fitting.fit_parameters(sticking, measured, 1)
    assert best.steps[0] == pytest.approx(truth, abs=0.01)
