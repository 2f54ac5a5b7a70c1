"""Generated operator motions: smooth, surgical, reachable, the same for the same seed."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console import motions
from ravenjax.robots.raven2.geometry import kinematics, limits
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES, matrix_from_quat

BOTH = ("gold", "green")
MOVING = [name for name in motions.MOTIONS if name != "still"]


def tip_path(motion, arm, scale=0.1):
    """Tip offsets [T, 3], m in frame 0, that the packets of a motion add up to."""
    hand = motion.position_um[:, motion.arms.index(arm)]
    steps = np.diff(hand, axis=0, prepend=hand[:1]) * (motion.surgeon_mode[:, None] > 0)
    return np.cumsum(steps, axis=0) @ np.array(ITP_AXES[arm]).T * scale * 1e-6


@pytest.mark.parametrize("name", motions.MOTIONS)
def test_same_seed_same_motion(name):
    first, again = (motions.generate_motion(name, 5.0, BOTH, seed=7) for _ in range(2))
    assert (first.table() == again.table()).all()
    longer = motions.generate_motion(name, 8.0, BOTH, seed=7)
    assert (longer.table()[: len(first)] == first.table()).all()


@pytest.mark.parametrize("name", motions.MOTIONS)
def test_begins_at_rest_with_the_pedal_up(name):
    motion = motions.generate_motion(name, 3.0, BOTH, seed=3)
    assert (motion.surgeon_mode[:200] == 0).all() and (motion.surgeon_mode[200:500] == 1).all()
    assert (motion.position_um[:500] == 0).all() and (motion.quat[:500] == [0, 0, 0, 1]).all()


@pytest.mark.parametrize("name", MOVING)
def test_surgical_in_speed_and_size(name):
    motion = motions.generate_motion(name, 30.0, BOTH, seed=11)
    for arm in BOTH:
        tip = tip_path(motion, arm)
        speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) * 1e3  # m/s
        assert 0.005 < speed.max() < 0.060
        assert 0.005 < np.ptp(tip, axis=0).max() < 0.040  # m


@pytest.mark.parametrize("name", MOVING)
def test_twice_differentiable(name):
    """Steps of the acceleration shrink with the time step: none is a jump of velocity or
    acceleration.

    Peak jerk of a minimum-jerk move of 25 mm in 1 s is 1.5 m/s3, of the shortest one (0.25 s) some
    100 m/s3: an acceleration then changes by at most 0.1 m/s2 within a millisecond; a kink in
    velocity of 1 mm/s would be 1 m/s2.
    """
    tip = tip_path(motions.generate_motion(name, 20.0, seed=2), "gold")
    acceleration = np.diff(tip, n=2, axis=0) * 1e6  # m/s2
    assert np.abs(np.diff(acceleration, axis=0)).max() < 0.1


def test_both_arms_share_the_pedal():
    motion = motions.generate_motion("clutched", 20.0, BOTH, seed=4)
    hands = np.abs(np.diff(motion.position_um, axis=0)).max(axis=2)
    up = motion.surgeon_mode[1:] == 0
    repositioned = up & (hands > 0).any(axis=1)
    assert repositioned.sum() > 1000
    # when the pedal comes down again both hands are back where they began
    downs = np.flatnonzero(np.diff(motion.surgeon_mode) > 0)[1:]
    assert np.abs(motion.position_um[downs]).max() < 1e-6


@pytest.fixture(scope="module")
def solve():
    """Joints [T, 7] and status [T] of the control software's own inverse kinematics along a
    path.
    """

    def along(arm, start, rotation, position, quat):
        def step(reference, now):
            turn = jnp.array(matrix_from_quat(Vec(now[1]))) @ rotation
            pose = kinematics.Pose(Vec(now[0]), Vec(Vec(row) for row in turn))
            ik = kinematics.inverse_joints(arm, pose, jnp.float64(np.pi / 2), Vec(reference))
            joints = jnp.where(ik.status == 0, jnp.array(ik.jpos), reference)
            return joints, (joints, ik.status)

        return jax.lax.scan(step, start, (position, quat))[1]

    jitted = jax.jit(along, static_argnums=0)

    def run(motion, arm, scale):
        i = motion.arms.index(arm)
        axes = np.array(ITP_AXES[arm])
        with jax.enable_x64(True):
            start = jnp.array([float(q) for q in motion.start_jpos[i]])
            home = kinematics.forward_pose(arm, Vec(start))
            position = np.array(home.position) + tip_path(motion, arm, scale)
            quat = np.concatenate([motion.quat[:, i, :3] @ axes.T, motion.quat[:, i, 3:]], axis=1)
            thin = slice(None, None, 5)  # 5 ms apart is dense enough for a pose
            return jax.tree.map(
                np.asarray, jitted(arm, start, jnp.array(home.rotation), position[thin], quat[thin])
            )

    return run


@functools.cache
def long_motion(name, seed):
    """40 s of it."""
    return motions.generate_motion(name, 40.0, BOTH, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.1, 0.2])
@pytest.mark.parametrize("arm", BOTH)
def test_reachable_inside_the_soft_limits(solve, arm, scale):
    """At twice the nominal scale nothing is rejected or clamped; at the nominal one there is a
    margin of 10 degrees.
    """
    soft = limits.soft_limits("r_grasper")
    margin = np.radians(10.0) if scale == 0.1 else 0.0
    for name in MOVING:
        for seed in (0, 1, 2016):
            joints, status = solve(long_motion(name, seed), arm, scale)
            assert (status == 0).all(), (name, seed)
            for j in (0, 1, 3, 4):
                assert joints[:, j].min() > soft.lower[j] + margin, (name, seed, j)
                assert joints[:, j].max() < soft.upper[j] - margin, (name, seed, j)
            # In m; the remote centre is at 0.457.
            assert soft.lower[2] < joints[:, 2].min() and joints[:, 2].max() < 0.44
