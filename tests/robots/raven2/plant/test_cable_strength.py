"""Cables of the power-consistent robot that part: statics at the stop, what a parted cable
leaves, energy.
"""

import jax
import numpy as np
import pytest
from plant_runs import (
    CAPSTAN_M,
    FRICTION_N,
    POWER_CONSISTENT,
    TORQUE_PER_COUNT,
    N,
    columns,
    constant,
    energy,
    frictionless,
    setup,
    simulate,
    swings,
    weightless,
)

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import robot

STRENGTH_N = 1200.0
BREAKING = setup(cables="break")


def params() -> robot.PlantParams:
    return robot.params(setup(), "gold", "power_consistent")


def pressed(counts: int, one=BREAKING):
    """The shoulder, at rest on its stop, pressed on it by a command that grows to `counts` and
    stays.
    """
    ramp = np.minimum(np.arange(800) / 600.0, 1.0)
    commands = (np.outer(ramp, [counts, 0, 0, 0, 0, 0, 0])).astype(np.int32)
    start = Vec(HOME_JPOS).replace(0, params().stops.lower[0])
    return simulate(one, commands, params(), jpos0=start)


@pytest.mark.parametrize(("share", "parts"), [(0.9, False), (1.1, True)])
def test_a_constant_torque_parts_the_cable_that_statics_cannot_carry(share, parts) -> None:
    counts = round(share * STRENGTH_N * CAPSTAN_M / TORQUE_PER_COUNT)
    with jax.enable_x64(True):
        state, out = pressed(counts)
    carried = columns(out.carried)[:, 0]
    assert np.array(state.intact).tolist() == [0.0 if parts else 1.0, *[1.0] * 6]
    if parts:
        broke = int(np.argmax(carried > STRENGTH_N))
        assert carried[broke] < 1.02 * STRENGTH_N  # a slow press does not overshoot
        assert (carried[broke + 1 :] == 0.0).all() and (
            columns(out.tension)[broke:, 0] == 0.0
        ).all()
        commanded = counts * min((broke + 1) / 600.0, 1.0) * TORQUE_PER_COUNT / CAPSTAN_M
        a_tick = counts / 600.0 * TORQUE_PER_COUNT / CAPSTAN_M
        assert commanded == pytest.approx(STRENGTH_N, abs=FRICTION_N + 2.0 * a_tick)
    else:
        assert carried[-1] == pytest.approx(share * STRENGTH_N, abs=1.1 * FRICTION_N)


@pytest.mark.slow
def test_parting_makes_no_energy_and_takes_that_of_the_spring() -> None:
    """Coasting against its own links; what a cable held when it parted is lost."""
    command = swings()
    with jax.enable_x64(True):
        one = setup()
        free = replace(frictionless(weightless(params())), cable_damping=Vec.full(N, 0.0))
        state, _ = simulate(one, command, free)
        state, _ = simulate(one, constant([0] * N, 100), free, state=state)
        coast = constant([0] * N, 300)
        _, whole = simulate(one, coast, free, state=state)
        carried = columns(whole.carried)
        # None parts at once.
        strength = np.maximum(0.9 * carried.max(axis=0), 1.01 * carried[:20].max(axis=0))
        weak = replace(free, cable_strength=Vec(strength))
        breakable = replace(state, intact=Vec.full(N, 1.0))
        end, out = simulate(BREAKING, coast, weak, state=breakable)
        total = energy(free, out)
    arm, stiffness = np.array(transmission.CABLE_PER_MOTOR), np.array(free.cable_stiffness)
    springs = 2.0 * stiffness * (np.cosh(arm * columns(out.stretch)) - 1.0)
    parted = columns(out.carried) > strength
    gone = np.logical_or.accumulate(parted, axis=0)
    total = total - (springs * gone).sum(axis=1)
    assert np.array(end.intact).min() == 0.0 and parted.any(axis=0).sum() >= 2
    assert (np.diff(total) < 1e-6 * total[0]).all()
    first = int(np.argmax(parted.any(axis=1)))
    assert first > 0
    lost = (springs * parted)[first].sum()
    assert lost > 1e-6 * total[0]
    assert total[first - 1] - total[first] > 0.9 * lost


def test_what_a_cable_carries_is_its_stretch_and_its_damping() -> None:
    """By the equation as written, from stretches before and after each step."""
    ticks = np.arange(400)[:, None]
    command = (np.array([3000, -3000, 3000, 800, -800, 800, -800]) * np.sin(ticks / 30.0)).astype(
        np.int32
    )
    with jax.enable_x64(True):
        _, out = simulate(setup(), command, params())
    arm = np.array(transmission.CABLE_PER_MOTOR)
    stretch = arm * columns(out.stretch)
    rate = np.diff(stretch, axis=0) / 1e-3
    force = (
        2.0 * np.array(POWER_CONSISTENT.cable_stiffness) * np.sinh(stretch[1:])
        + 2.0 * np.array(POWER_CONSISTENT.cable_damping) * rate
    )
    np.testing.assert_allclose(columns(out.carried)[1:], np.abs(force), rtol=1e-4, atol=1e-6)
    assert (
        columns(out.carried)[1:] / np.maximum(np.abs(columns(out.tension)[1:]), 1e-9)
    ).max() > 2.0
