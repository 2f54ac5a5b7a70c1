"""The hand on its spring: against the formulas of a second-order system, and its energy to the
last digit.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.numbers.setup import REFERENCE, Setup
from ravenjax.numbers.vec import Vec, replace
from ravenjax.stages import hand
from ravenjax.vocabulary import TICK_S

SETUP = Setup(precision=REFERENCE)
H = TICK_S


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


def constants(**changes):
    """A hand whose numbers are as given: grip 0, one newton a unit."""
    return replace(hand.HandParams(), **{"grip": 0.0, "newtons_per_unit": 1.0, **changes})


def three(values):
    return Vec(jnp.float64(x) for x in values)


def moved(params, forces):
    """Displacement (m) and velocity (m/s) after each tick, [ticks + 1, 3]; forces: N, [ticks,
    3].
    """

    def tick(state, force):
        state = hand.step(SETUP, params, state, Vec(force))
        return state, (jnp.stack(state.displacement), jnp.stack(state.velocity))

    rows = jax.lax.scan(tick, hand.init(SETUP), jnp.asarray(forces, float))[1]
    return tuple(np.concatenate([np.zeros((1, 3)), np.asarray(part)]) for part in rows)


def step_response(mass, damping, stiffness, force, time):
    """Displacement of a mass at rest after a force sets in, by the textbook: under, critically
    and over damped.
    """
    natural = np.sqrt(stiffness / mass)
    ratio = damping / (2.0 * np.sqrt(stiffness * mass))
    if ratio < 1.0:
        damped = natural * np.sqrt(1.0 - ratio**2)
        wave = np.cos(damped * time) + ratio * natural / damped * np.sin(damped * time)
        return force / stiffness * (1.0 - np.exp(-ratio * natural * time) * wave)
    if ratio == 1.0:
        return force / stiffness * (1.0 - (1.0 + natural * time) * np.exp(-natural * time))
    fast, slow = (-natural * (ratio + sign * np.sqrt(ratio**2 - 1.0)) for sign in (1.0, -1.0))
    return (
        force
        / stiffness
        * (1.0 + (slow * np.exp(fast * time) - fast * np.exp(slow * time)) / (fast - slow))
    )


@pytest.mark.parametrize(
    ("mass", "damping", "stiffness"),
    [
        (0.554, 6.45, 135.0),
        (0.554, 6.45 * np.sqrt(5.0), 675.0),
        (0.5, 20.0, 200.0),
        (0.1, 30.0, 400.0),
    ],
    ids=["relaxed", "firm", "critical", "over"],
)
def test_a_force_that_sets_in_moves_it_as_the_textbook_says(mass, damping, stiffness):
    params = constants(mass=mass, damping=damping, stiffness=stiffness)
    force, ticks = np.array([0.165, -0.05, 0.0]), 1500
    place, _ = moved(params, np.tile(force, (ticks, 1)))
    expected = step_response(mass, damping, stiffness, force[:, None], np.arange(ticks + 1) * H).T
    np.testing.assert_allclose(place, expected, atol=4e-4 * abs(force[0] / stiffness))
    assert np.ptp(expected[:, 0]) > 0.9 * force[0] / stiffness


numbers = st.floats(-5.0, 5.0)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    forces=st.lists(st.tuples(numbers, numbers, numbers), min_size=5, max_size=40),
    mass=st.floats(0.01, 10.0),
    damping=st.floats(0.0, 1000.0),
    stiffness=st.floats(0.0, 1e5),
    grip=st.floats(0.0, 1.0),
)
def test_it_never_makes_energy(forces, mass, damping, stiffness, grip):
    """What it holds is what the force put in less what its damper took, whatever its numbers and
    the force.
    """
    params = constants(mass=mass, damping=damping, stiffness=stiffness, grip=grip)
    held_stiffness, held_damping = (float(x) for x in hand.hand_impedance(params))
    forces = np.array(forces)
    place, speed = moved(params, forces)
    energy = 0.5 * mass * (speed**2).sum(axis=1) + 0.5 * held_stiffness * (place**2).sum(axis=1)
    put_in = np.cumsum((forces * np.diff(place, axis=0)).sum(axis=1))
    mean = 0.5 * (speed[1:] + speed[:-1])
    taken = np.cumsum(H * held_damping * (mean**2).sum(axis=1))
    np.testing.assert_allclose(
        energy[1:], put_in - taken, rtol=1e-6, atol=1e-9 * (1.0 + np.abs(put_in).max())
    )
    assert (energy[1:] <= put_in + 1e-9 * (1.0 + np.abs(put_in).max())).all()


def test_the_largest_displacement_is_kept():
    params, state = constants(), hand.init(SETUP)
    for force in [2.0] * 200 + [0.0] * 400:
        state = hand.step(SETUP, params, state, three((force, 0.0, 0.0)))
    place, _ = moved(params, np.array([[2.0, 0, 0]] * 200 + [[0.0, 0, 0]] * 400))
    assert float(state.peak) == pytest.approx(np.abs(place[:, 0]).max(), rel=1e-9)
    other = replace(state, peak=jnp.float64(0.5))
    assert float(hand.outcomes(SETUP, (state, other))["hand_mm"]) == 500.0
