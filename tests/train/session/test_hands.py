"""The operator's hands: messages become rows of motion, which the console of the tick turns into
packets.
"""

import contextlib
import json
import tempfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.geometry import mapping, scene
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.train.scenario import Speeds
from ravenjax.train.session.hands import SMOOTHING_MS, Hands
from ravenjax.train.session.scripts import read_commands

ARMS = ("gold", "green")
SETUP = RavenSetup(arms=ARMS, tools=("r_grasper", "r_grasper"))
HOME = ((0.5, 1.5, 0.4, 0.0, 0.0, 0.7, 0.7),) * 2
RATE = 3.8897 / SMOOTHING_MS  # 1/ms, of a critically damped step that is at 90 % after SMOOTHING_MS


def hands(arms=ARMS, scale=0.1, **speeds):
    return Hands(arms, scale, Speeds(**speeds))


def said(pedal=True, **arms):
    return {"type": "input", "source": "test", "pedal": pedal, "arms": arms}


def incremented(pedal=True, **arms):
    return {"type": "increments", "source": "test", "pedal": pedal, "arms": arms}


def packets(rows, scale):
    """What the console of the tick sends for rows [T, columns]: deltas [T-1, A, 3], quats [T-1,
    A, 4], grasps.
    """
    table = tuple(jnp.asarray(column, jnp.float32) for column in np.asarray(rows).T)
    params = replace(operator.params(SETUP, HOME), scale=scale)
    ticks = jnp.arange(1, len(rows), dtype=jnp.int32)
    packet = jax.vmap(
        lambda tick: operator.make_packet(SETUP, params, table, operator.row_timing(tick))
    )(ticks)
    return (
        np.moveaxis(np.array(packet.delta), 2, 0),
        np.moveaxis(np.array(packet.quat), 2, 0),
        np.array(packet.grasp).T,
    )


def advanced(who, ticks, first=0):
    return np.array([who.advance(first + k).columns.copy() for k in range(ticks)])


def tip_way(arm, rows, scale=0.1):
    """Way of the tip in the world, mm, as robot.mapping and robot.scene have it."""
    hand = (rows[-1] - rows[0])[ARMS.index(arm) * 8 :][:3] * scale
    way = mapping.position_from_itp(arm, Vec(map(float, hand)))
    origin = scene.to_world(arm, Vec((0.0, 0.0, 0.0)))
    return np.array([a - b for a, b in zip(scene.to_world(arm, way), origin, strict=True)]) * 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.05, 0.1, 0.15, 0.3, 1.0])
def test_the_robot_gets_exactly_the_increments_of_a_console(scale):
    rng = np.random.default_rng(1)
    deltas = rng.integers(-900, 900, (400, 2, 3))
    # About zero, where truncation changes its direction.
    deltas[:40] = rng.integers(-1, 2, (40, 2, 3))
    deltas[200:260] += 9_000  # far out, where single precision is coarse
    grasps = rng.integers(-30, 30, (400, 2))
    who = hands(scale=scale)
    rows = [who.advance(0).columns.copy()]
    for k in range(400):
        each = {
            arm: {
                "delta_um": deltas[k, i].tolist(),
                "quat": [0, 0, 0, 1],
                "grasp_mrad": int(grasps[k, i]),
            }
            for i, arm in enumerate(ARMS)
        }
        assert who.apply(incremented(**each), k + 1)
        rows.append(who.advance(k + 1).columns.copy())
    delta, _, grasp = packets(rows, scale)
    np.testing.assert_array_equal(delta, deltas)
    np.testing.assert_array_equal(grasp, grasps)


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(
    ("move", "world"),
    [
        *(((1, 0, 0), (1, 0, 0)), ((0, 1, 0), (0, 0, 1))),
        *(((0, 0, 1), (0, -1, 0)), ((3, 4, 0), (0.6, 0, 0.8))),
    ],
)
def test_moving_in_the_view_moves_the_tip_so_in_the_world_at_the_asked_speed(arm, move, world):
    who = hands(move_mm_s=20.0)
    for k in range(0, 1000, 100):
        who.apply(said(**{arm: {"move": list(move)}}), k)
        rows = advanced(who, 100, k)
    way = tip_way(arm, rows)  # of the last 99 ms, at full speed; longer input is cut to length 1
    np.testing.assert_allclose(way, np.array(world) * 20.0 * 0.099, atol=0.003)


@pytest.mark.parametrize("arm", ARMS)
def test_turning_about_the_views_up_turns_the_tip_about_the_worlds_z(arm):
    who = hands(turn_rad_s=0.5)
    start = advanced(who, 1)[0]
    for k in range(1, 1001, 100):
        who.apply(said(**{arm: {"turn": [0, 1, 0]}}), k)
        end = advanced(who, 100, k)[-1]
    at = ARMS.index(arm) * 8
    assert start[at + 3 : at + 7].tolist() == [0, 0, 0, 1]
    x, y, z, w = (float(c) for c in end[at + 3 : at + 7])
    axis = mapping.position_from_itp(arm, Vec((x, y, z)))
    turned = np.array(scene.frame0_in_world(arm)[1]) @ np.array([float(c) for c in axis])
    angle = 2 * np.arctan2(np.linalg.norm(turned), w)
    np.testing.assert_allclose(turned / np.linalg.norm(turned), [0, 0, 1], atol=1e-6)
    # A second, less the time of taking it up.
    assert angle == pytest.approx(0.5 * (1.0 - 2e-3 / RATE), rel=0.01)


def test_hands_take_up_a_speed_smoothly_and_let_go_of_it_so():
    who = hands(move_mm_s=30.0)
    who.apply(said(gold={"move": [1, 0, 0]}), 0)
    rows = advanced(who, 200)
    speed = np.diff(rows[:, 1]) * 0.1  # mm/s of the tip: itp y is the world's x
    assert np.all(np.diff(speed) > -0.05) and speed.max() < 30.1  # no overshoot
    assert speed[int(SMOOTHING_MS) - 2] == pytest.approx(27.0, abs=0.4)  # 90 %
    # No jump: the steepest of a critically damped step.
    assert np.abs(np.diff(speed)).max() < 1.05 * 30.0 * RATE / np.e
    who.apply(said(), 200)
    rest = advanced(who, 200, 200)
    # um before scaling in 49 ms
    assert rest[0, 1] > rows[-1, 1] and 0 <= rest[-1, 1] - rest[-50, 1] < 5.0


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)
_NAMES = ("move", "turn", "grasp", "delta_um", "quat", "grasp_mrad")
_TABLE = st.dictionaries(st.sampled_from(_NAMES), _JSON | st.lists(st.floats(), max_size=4))
_KEYED = st.fixed_dictionaries(
    {
        "type": st.sampled_from(["input", "increments"]),
        "pedal": st.booleans() | _JSON,
        "arms": st.dictionaries(st.sampled_from(["gold", "green", "x"]), _TABLE),
    }
)


@settings(max_examples=20, deadline=None)
@given(st.lists(_KEYED, max_size=5))
def test_nothing_that_a_script_says_raises_or_makes_numbers_that_are_none(messages):
    who, good = hands(), []
    for message in messages:
        with tempfile.NamedTemporaryFile("w") as file:
            file.write(json.dumps({"tick": 0, "message": message}))
            file.flush()
            with contextlib.suppress(UserError):
                good += read_commands(file.name)
    for tick, (_, message) in enumerate(good):
        who.apply(message, tick)
        assert np.isfinite(who.advance(tick).columns).all()
