"""Encoder signs, both velocity estimators and the couplings' agreement with the transmission."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.numbers.setup import ORIGINAL
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import estimator

RAVEN2 = RavenSetup(precision=ORIGINAL)
FORK = RavenSetup(software="fork2015", tools=("r_grasper_B",), precision=ORIGINAL)


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def run(setup, samples, arm="gold", tool="r_grasper", offset=0):
    """mpos and mvel of joint 2 (insertion) over counts of all joints."""
    params = estimator.EstimatorParams(Vec.full(7, np.int32(offset)))
    state, positions, velocities = estimator.init(setup), [], []
    for count in samples:
        state, mpos, mvel = estimator.step(
            setup, arm, tool, params, state, Vec.full(7, np.int32(count))
        )
        positions.append([float(x) for x in mpos])
        velocities.append([float(x) for x in mvel])
    return np.array(positions), np.array(velocities)


def test_one_count_per_millisecond_is_half_pi_per_second():
    positions, velocities = run(RAVEN2, [0, -1, -2, -2])
    assert positions[:, 2] == pytest.approx(np.array([0, 1, 2, 2]) * 2 * np.pi / 4000, rel=1e-6)
    assert velocities[:, 2] == pytest.approx([0, 1.5708, 1.5708, 0], rel=1e-5)


def test_offset_is_subtracted_after_the_sign():
    positions, _ = run(RAVEN2, [-1000], offset=600)
    assert positions[0] * 4000 / (2 * np.pi) == pytest.approx(
        [400, 400, 400, 400, 400, -1600, 400], rel=1e-6
    )


@pytest.mark.slow
def test_the_fork_filters_with_the_stated_butterworth():
    rng = np.random.default_rng(1)
    samples = np.cumsum(rng.integers(-30, 30, 200))
    positions, velocities = run(FORK, samples)
    x, y = -samples * 2 * np.pi / 4000, np.zeros(200)
    b, a = (0.02864, 0.08591, 0.08591, 0.02864), (1.5189, -0.96, 0.2120)
    for k in range(200):
        past = [(x[max(k - i, 0)], y[k - i] if k >= i else x[0]) for i in range(4)]
        y[k] = sum(b[i] * past[i][0] for i in range(4)) + sum(
            a[i - 1] * past[i][1] for i in range(1, 4)
        )
    assert positions[:, 2] == pytest.approx(y, abs=2e-6)
    assert velocities[1:, 2] == pytest.approx(np.diff(y) * 1000, abs=2e-3)


@pytest.mark.parametrize("setup", [RAVEN2, FORK], ids=["raven2", "fork2015"])
@pytest.mark.parametrize("arm", ["gold", "green"])
@pytest.mark.parametrize("tool", ["r_grasper", "large_needle", "r_sq_grasper"])
def test_joints_are_those_of_the_transmission(setup, arm, tool):
    mpos = transmission.motor_from_joint(arm, tool, HOME_JPOS, software=setup.software)
    jpos = estimator.joints(setup, arm, tool, Vec(map(np.float32, mpos)))
    assert [float(x) for x in jpos] == pytest.approx(list(HOME_JPOS), abs=2e-5)


def test_joint_velocities_are_uncoupled_and_zero_for_the_tool():
    jvel = estimator.joint_velocities(RAVEN2, Vec.full(7, np.float32(100.0)))
    expected = [
        100 / 136.19625550660794,
        100 / 121.52207496453373,
        100 / 2158.590308370044,
        0,
        0,
        0,
        0,
    ]
    assert [float(x) for x in jvel] == pytest.approx(expected, rel=1e-6)
