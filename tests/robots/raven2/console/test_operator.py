"""Operator: looked-up rows, packets of increments and of absolute poses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ravenjax.numbers.setup import CAMPAIGN, REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.console import motions, operator
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.robots.raven2.setup import RavenSetup

BOTH = ("gold", "green")


def make_setup(console="increments", precision=CAMPAIGN) -> RavenSetup:
    return RavenSetup(arms=BOTH, tools=("r_grasper",) * 2, console=console, precision=precision)


def packets(setup, motion, scale):
    """Every packet of a motion, arrays [T]."""
    table = tuple(jnp.asarray(column) for column in motion.table().T)
    params = replace(operator.params(setup, motion.start_jpos), scale=scale)

    def one(k):
        return operator.make_packet(setup, params, table, operator.row_timing(k))

    return jax.tree.map(
        np.asarray, jax.jit(jax.vmap(one))(jnp.arange(len(motion), dtype=jnp.int32))
    )


@pytest.fixture(scope="module")
def motion():
    return motions.generate_motion("suture", 6.0, BOTH, seed=5)


@pytest.mark.parametrize("scale", [0.05, 0.1, 0.2])
def test_increments_add_up_to_the_scaled_hand(motion, scale):
    """No drift: after any packet the sum is the truncated scaled position, so it is within 1 um
    of it.
    """
    sent = packets(make_setup(), motion, scale)
    for i in range(2):
        total = np.cumsum(np.stack(sent.delta[i], axis=1), axis=0)
        hand = motion.position_um[:, i].astype(np.float32) * np.float32(scale)
        assert (total == np.trunc(hand)).all()
        assert np.abs(total - scale * motion.position_um[:, i]).max() < 1.01


def test_increment_quaternions_compose_to_the_hand(motion):
    sent = packets(make_setup(precision=CAMPAIGN), motion, 0.1)
    for i in range(2):
        turn = Rotation.identity()
        steps = Rotation.from_quat(np.stack(sent.quat[i], axis=1).astype(float))
        for step in steps:
            turn = step * turn
        apart = (turn * Rotation.from_quat(motion.quat[-1, i]).inv()).magnitude()
        # Float32 columns: 6e-8 a tick over 6000 ticks, as a random walk and its bias.
        assert apart < 2e-5
        assert np.abs(np.linalg.norm(np.stack(sent.quat[i], axis=1), axis=1) - 1.0).max() < 3e-7


def test_pedal_up_sends_no_motion():
    motion = motions.generate_motion("clutched", 8.0, BOTH, seed=1)
    sent = packets(make_setup(), motion, 0.1)
    up = motion.surgeon_mode == 0
    assert up[200:].any()
    moved = np.abs(np.diff(motion.position_um[:, 0], axis=0)).max(axis=1)
    assert moved[up[1:]].max() > 100.0  # the hand does move there
    assert all((delta[up] == 0).all() for delta in sent.delta[0])
    assert (np.stack(sent.quat[0], axis=1)[up] == [0, 0, 0, 1]).all()
    assert (sent.grasp[0][up] == 0).all()


@pytest.mark.parametrize("arm", BOTH)
def test_absolute_packets_are_the_pose_in_frame_0(motion, arm):
    i = BOTH.index(arm)
    with jax.enable_x64(True):
        sent = packets(make_setup("absolute", REFERENCE), motion, 0.1)
    sign = 1 if arm == "gold" else -1
    # Home; raven2's own kinematics.
    start = np.array([-77946.997893, sign * -25265.555299, 13225.627957])
    axes = np.array(ITP_AXES[arm])
    expected = start + motion.position_um[:, i].astype(np.float32) * 0.1 @ axes.T
    # A truncation at a whole number.
    assert np.abs(np.stack(sent.delta[i], axis=1) - np.trunc(expected)).max() <= 1
    assert (sent.size == 204).all()
    home = Rotation.from_quat(
        [float(c) for c in operator.params(make_setup(), motion.start_jpos).start_quat[i]]
    )
    last = (
        Rotation.from_matrix(axes)
        * Rotation.from_quat(motion.quat[-1, i])
        * Rotation.from_matrix(axes).inv()
        * home
    )
    assert (last * Rotation.from_quat([c[-1] for c in sent.quat[i]]).inv()).magnitude() < 1e-6
    assert sent.grasp[i][0] == 1570


def vectors(*rows):
    return tuple(Vec(jnp.float64(x) for x in row) for row in rows)


def numbers(vecs):
    return np.array([[float(x) for x in vec] for vec in vecs])


@pytest.mark.slow
def test_what_hands_do_beyond_the_plan_is_sent_once_and_adds_up(motion):
    """Increments follow the plan and the strays: after any packet the sum is the truncated
    scaled hand.
    """
    setup = make_setup(precision=REFERENCE)
    with jax.enable_x64(True):
        table = tuple(jnp.asarray(column) for column in motion.table().T)
        params, hands = operator.params(setup, motion.start_jpos), operator.hands_on_plan(setup)
        total, rng = np.zeros((2, 3)), np.random.default_rng(4)
        for k in range(300, 330):
            stray = rng.uniform(-50.0, 50.0, (2, 3))
            hands = operator.add_hand_motion(hands, vectors(*stray))
            timing = operator.row_timing(k)
            total += numbers(operator.make_packet(setup, params, table, timing, hands).delta)
            hands = operator.mark_sent(hands, jnp.bool_(True))
        begun = np.trunc(motion.position_um[299].astype(np.float32).astype(float) * 0.1)
        whole = np.trunc((motion.position_um[329].astype(np.float32) + numbers(hands.offset)) * 0.1)
        assert np.abs(numbers(hands.offset)).max() > 100.0
        np.testing.assert_array_equal(total, whole - begun)
