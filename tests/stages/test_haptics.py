"""The haptic cue against the rule written out in NumPy, and its record of outcomes."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import haptics

SETUP = RavenSetup(precision=REFERENCE)
coordinate = st.floats(-0.02, 0.02)
speed = st.floats(-0.5, 0.5)
three = lambda number: st.tuples(number, number, number)  # noqa: E731


def by_the_rule(p_model, v_model, p_robot, v_robot) -> float:
    error = np.subtract(p_model, p_robot)
    distance = np.linalg.norm(error)
    if distance <= 3e-3:
        return 0.0
    force = 4.5 * distance + 0.09 * np.dot(np.subtract(v_model, v_robot), error / distance)
    return float(np.clip(force, 0.0, 0.05))


def one_tick(params, state, p_model, v_model, p_robot=(0, 0, 0), v_robot=(0, 0, 0)):
    motions = (Vec(map(jnp.float64, item)) for item in (p_model, v_model, p_robot, v_robot))
    return haptics.step(params, state, *motions)


@settings(max_examples=60, deadline=None)
@given(three(coordinate), three(speed), three(coordinate), three(speed))
def test_force_follows_the_rule(p_model, v_model, p_robot, v_robot) -> None:
    with jax.enable_x64(True):
        params = haptics.params(SETUP)
        _, out = one_tick(params, haptics.init(SETUP), p_model, v_model, p_robot, v_robot)
        np.testing.assert_allclose(
            out.force[0], by_the_rule(p_model, v_model, p_robot, v_robot), atol=1e-12
        )


def test_published_points() -> None:
    """Figure 5: nothing at 2.9 mm, about 0.0045 per mm above 3 mm, flat at the cap, never
    pushing away.
    """
    with jax.enable_x64(True):
        params = haptics.params(SETUP)
        state = haptics.init(SETUP)
        points = [
            (2.9, 0, 0.0),
            (3.65, 0, 0.0164),
            (20, 0, 0.05),
            (4, -1.0, 0.0),
            (5, 0.08, 0.0297),
        ]
        for error_mm, closing, expected in points:
            _, out = one_tick(params, state, (error_mm * 1e-3, 0, 0), (closing, 0, 0))
            np.testing.assert_allclose(out.force[0], expected, atol=5e-5)
        _, out = one_tick(params, state, (0, 0, 0), (1, 1, 1))
        assert float(out.force[0]) == 0.0 and np.isfinite(np.asarray(out.direction)).all()


def test_cues_side_by_side_keep_their_own_record() -> None:
    setup = RavenSetup(cues=2, precision=REFERENCE)
    with jax.enable_x64(True):
        fine, coarse = (
            haptics.CueParams(1e-3, 4.5, 0.0, 0.05),
            haptics.CueParams(3e-3, 4.5, 0.0, 0.05),
        )
        params = haptics.HapticParams(cues=(fine, coarse))
        state = haptics.init(setup)
        for error_mm in (0, 2, 4, 5, 2, 0, 4, 0):
            state, _ = one_tick(params, state, (error_mm * 1e-3, 0, 0), (0, 0, 0))
    first, second = state.cues
    assert [int(x) for x in (first.first_tick, first.ticks_active, first.impulses)] == [1, 5, 2]
    assert [int(x) for x in (second.first_tick, second.ticks_active, second.impulses)] == [2, 3, 2]
    np.testing.assert_allclose(float(first.peak_force), 4.5 * 5e-3)
    assert int(state.tick) == 8
