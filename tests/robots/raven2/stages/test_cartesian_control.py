"""Poses and joint targets of the stage alone."""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from printed_python import printed

from ravenjax.numbers.setup import ORIGINAL
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import cartesian_control as control

SETUP = RavenSetup(arms=("gold", "green"), tools=("r_grasper",) * 2, precision=ORIGINAL)
FORK = RavenSetup(software="fork2015", tools=("r_grasper_B",), precision=ORIGINAL)
AWAY = HOME_JPOS.replace(4, 0.3).replace(3, 0.4)


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def joints(*values):
    return Vec(map(np.float32, values))


@functools.cache
def solver(setup):
    return printed(functools.partial(control.solve, setup))


def solve(setup, state, jpos, active=True):
    return solver(setup)(control.params(setup), state, jnp.int32(0), jnp.bool_(active), jpos)


@pytest.mark.parametrize(("arm", "y"), [("gold", -25265), ("green", 25265)])
def test_home_pose_in_whole_micrometres(arm, y):
    pose = control.measure(SETUP, arm, joints(*HOME_JPOS))
    assert [int(x) for x in pose.position_um] == [-77946, y, 13225]
    assert int(pose.grasp_mrad) == 1570


def test_a_measured_pose_solves_to_its_joints():
    rest = (AWAY, AWAY)
    state, clamped = solve(SETUP, control.init(SETUP, rest), tuple(joints(*arm) for arm in rest))
    assert not bool(clamped)
    for arm in state:
        # Whole micrometres turn the 13 mm wrist by up to 0.1 mrad, whole milliradians each jaw by
        # 0.5 mrad.
        assert [float(j) for j in arm.jpos_d[:5]] == pytest.approx(list(AWAY[:5]), abs=2e-4)
        assert [float(j) for j in arm.jpos_d[5:]] == pytest.approx(list(AWAY[5:]), abs=6e-4)
        assert float(arm.ik_reject.margin) == pytest.approx(math.pi, abs=1e-4)


def test_inactive_arms_hold_and_check_nothing():
    state = control.init(SETUP, (AWAY, AWAY))
    after, clamped = solve(SETUP, state, (joints(*HOME_JPOS),) * 2, active=False)
    assert not bool(clamped)
    assert [float(x) for x in jax.tree.leaves(after)] == [float(x) for x in jax.tree.leaves(state)]


@pytest.mark.parametrize(
    ("setup", "joint", "outside", "limit"),
    [
        (SETUP, 0, 1.65, math.pi / 2),
        (SETUP, 1, 2.45, 3 * math.pi / 4),
        (SETUP, 2, 0.2, 0.23),
        (SETUP, 3, -3.3, None),
        (SETUP, 4, 1.4, math.radians(70)),
        (FORK, 3, 2.8, math.radians(150)),
        (FORK, 4, 1.4, math.radians(75)),
    ],
)
def test_each_joint_is_clamped_and_the_wanted_pose_follows(setup, joint, outside, limit):
    beyond = AWAY.replace(joint, outside)
    rest = (beyond,) * len(setup.arms)
    state, clamped = solve(setup, control.init(setup, rest), tuple(joints(*arm) for arm in rest))
    arm = state[0]
    if limit is None:  # -3.3 rad of roll is measured as 2.98, within 182 deg
        assert not bool(clamped)
        return
    assert bool(clamped)
    assert float(arm.jpos_d[joint]) == float(np.float32(limit))
    there = control.measure(setup, "gold", Vec(arm.jpos_d))
    assert [int(x) for x in arm.pos_d.position_um] == pytest.approx(
        [int(x) for x in there.position_um], abs=2
    )
    assert int(arm.joint_limit.count) == 1
    assert float(arm.joint_limit.margin) < 0


def test_the_forks_roll_limit_is_a_double_and_the_others_are_float32():
    for setup, roll in ((SETUP, float(np.float32(math.radians(182)))), (FORK, math.radians(150))):
        limits = control.params(setup)
        assert (limits.lower[3], limits.upper[3]) == (-roll, roll)
        assert limits.upper[1] == float(np.float32(3 * math.pi / 4))


def test_nan_in_the_wanted_pose_is_rejected():
    state = control.init(SETUP, (AWAY, AWAY))
    spoilt = replace(
        state[0].pos_d, rotation=Vec(Vec.full(3, np.float32(np.nan)) for _ in range(3))
    )
    after, clamped = solve(SETUP, (replace(state[0], pos_d=spoilt), state[1]), (joints(*AWAY),) * 2)
    assert not bool(clamped)
    assert int(after[0].ik_reject.count) == 1
    assert [float(j) for j in after[0].jpos_d] == [float(j) for j in state[0].jpos_d]
