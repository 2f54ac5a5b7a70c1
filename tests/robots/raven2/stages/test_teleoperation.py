"""Accumulation, origin resets, hand-over and the master timeout."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.setup import ORIGINAL
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry.stored_pose import StoredPose
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import teleoperation as teleop

SETUP = RavenSetup(precision=ORIGINAL)
FORK = RavenSetup(software="fork2015", tools=("r_grasper_B",), precision=ORIGINAL)
ABSOLUTE = RavenSetup(
    software="fork2015", tools=("r_grasper_B",), console="absolute", precision=ORIGINAL
)
UPRIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def pose(position=(0, 0, 0), grasp=0, rotation=UPRIGHT):
    rows = Vec(Vec(map(np.float32, row)) for row in rotation)
    return StoredPose(Vec(map(jnp.int32, position)), rows, jnp.int32(grasp))


def packet(delta=(0, 0, 0), quat=(0.0, 0.0, 0.0, 1.0), grasp=0, mode=1, sequence=5):
    return Packet(
        1,
        124,
        sequence,
        (Vec(map(jnp.int32, delta)),),
        (Vec(map(jnp.float64, quat)),),
        (jnp.int32(grasp),),
        mode,
    )


def taken(setup, given, start=None):
    state = teleop.init(setup, (start or pose(),))
    return teleop.accumulate(setup, teleop.params(setup), state, jnp.bool_(True), given)


def ints(vec):
    return [int(x) for x in vec]


def test_increments_are_mapped_from_the_console_and_wrap_at_32_bits():
    state = taken(SETUP, packet((1, 20, 300)), pose((2**31 - 1, 0, 0)))
    assert ints(state.arms[0].pose.position_um) == [2**31 - 301, -1, 20]
    state = taken(SETUP, packet((1, 20, -300)), pose((2**31 - 1, 0, 0)))
    assert ints(state.arms[0].pose.position_um) == [-(2**31) + 299, -1, 20]


@pytest.mark.parametrize(
    ("setup", "start", "grasp", "expected"),
    [
        (SETUP, 500, 100, 400),
        (SETUP, 500, 900, -174),
        (SETUP, 500, -2000, 1570),
        (FORK, 500, 100, 300),
        (FORK, 500, 900, -523),
        (ABSOLUTE, 500, 1900, 1900),
    ],
)
def test_opening(setup, start, grasp, expected):
    assert (
        int(taken(setup, packet(grasp=grasp), pose(grasp=start)).arms[0].pose.grasp_mrad)
        == expected
    )


def test_a_quarter_turn_about_the_consoles_z_is_one_about_minus_x_of_gold():
    half = np.sqrt(0.5)
    rotation = taken(SETUP, packet(quat=(0.0, 0.0, half, half))).arms[0].pose.rotation
    assert np.array(rotation, float) == pytest.approx(
        np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), abs=1e-7
    )


def hand_over(state, pedal_down, desired=None):
    given = (desired or pose((7, 7, 7)),)
    return teleop.hand_over(
        SETUP, teleop.params(SETUP), state, jnp.int32(0), jnp.bool_(pedal_down), given
    )


def test_the_device_takes_the_sum_in_pedal_down_when_it_changed():
    state = taken(SETUP, packet((0, 0, -5)))
    assert ints(hand_over(state, False)[1][0].position_um) == [7, 7, 7]
    after, wanted = hand_over(state, True)
    assert ints(wanted[0].position_um) == [5, 0, 0]
    assert ints(hand_over(after, True)[1][0].position_um) == [7, 7, 7]


def test_after_5000_cycles_without_update_the_pedal_counts_as_up():
    state, _ = hand_over(taken(SETUP, packet()), True)
    ages = []
    state = replace(state, age_ticks=jnp.int32(4998))
    for _ in range(4):
        state, wanted = hand_over(state, True)
        ages.append((int(state.age_ticks), int(state.surgeon_mode), ints(wanted[0].position_um)[0]))
    assert ages == [(4999, 1, 7), (5000, 1, 7), (0, 0, 0), (1, 0, 7)]
    assert (int(state.timeout.count), float(state.timeout.margin)) == (1, -1.0)


def test_reset_origin_takes_the_pose_counts_as_update_and_keeps_a_near_opening():
    state, turned = taken(SETUP, packet((1, 2, 3))), np.diag([1.0, -1.0, -1.0])
    for opening, expected in ((785, 0), (786, 786), (-785, 0), (-786, -786)):
        reset = teleop.reset_origin(
            SETUP, state, jnp.bool_(True), (pose((4, 5, 6), opening, turned),)
        )
        arm = reset.arms[0]
        assert (ints(arm.pose.position_um), int(arm.pose.grasp_mrad)) == ([4, 5, 6], expected)
        assert [abs(float(q)) for q in arm.quaternion] == [1.0, 0.0, 0.0, 0.0]
        assert int(reset.updated) == 1
    kept = teleop.reset_origin(SETUP, state, jnp.bool_(False), (pose((4, 5, 6)),))
    assert ints(kept.arms[0].pose.position_um) == ints(state.arms[0].pose.position_um)
