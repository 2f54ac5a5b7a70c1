"""The power-consistent robot: statics of motor, gear and drum, limits of amplifier and supply,
energy, brakes.
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
    frictionless,
    setup,
    simulate,
    weightless,
)

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.plant.coupling import arm_coupling


def params(name: str = "power_consistent") -> robot.PlantParams:
    return robot.params(setup(), "gold", name)


def test_at_the_stop_the_cable_carries_what_statics_say() -> None:
    """-10 000 counts after the checks press the shoulder on its stop; friction and offset take a
    few newtons.
    """
    command = constant([10000, 0, 0, 0, 0, 0, 0], 1000)
    with jax.enable_x64(True):
        tension = {}
        for name in ("power_consistent", "traj3"):
            _, out = simulate(setup(), command, params(name))
            assert abs(columns(out.jvel)[-1, 0]) < 1e-3
            tension[name] = abs(columns(out.tension)[-1, 0])
    statics = 10000 * TORQUE_PER_COUNT / CAPSTAN_M
    assert statics == pytest.approx(476.8, abs=0.1)
    assert abs(tension["power_consistent"] - statics) < 1.1 * FRICTION_N
    assert tension["traj3"] > 10.0 * statics  # the authors' law, kept for regression


def test_a_load_on_the_joint_is_balanced_by_its_torque_through_the_gear() -> None:
    """Principle of virtual work: the joint's load times its travel is the motor's torque times
    its own.
    """
    counts, joint = 2000, 1
    with jax.enable_x64(True):
        free = frictionless(weightless(params()))
        sign = transmission.tau_signs("gold", "r_grasper", "raven2")[joint]
        shaft = int(sign) * counts * TORQUE_PER_COUNT / transmission.GEARBOX[joint]
        pull = Vec.full(N, 0.0).replace(joint, -shaft)
        load = arm_coupling("gold", "r_grasper", "raven2").joint_loads(pull)
        command = constant([0, counts, 0, 0, 0, 0, 0], 400)
        _, balanced = simulate(setup(), command, free, external_torque=load)
        _, unbalanced = simulate(setup(), command, free)
    moved = [
        np.abs(columns(out.jpos)[-1, joint] - HOME_JPOS[joint]) for out in (balanced, unbalanced)
    ]
    assert moved[0] < 0.02 * moved[1] and moved[1] > 0.05


def test_no_motor_is_faster_than_its_supply_lets_it_be() -> None:
    command = constant([32767, 0, 0, 0, 0, 0, 0], 1000)
    cut = Vec.full(N, 1.0).replace(0, 0.0)
    with jax.enable_x64(True):
        speed = {}
        for name in ("power_consistent", "traj3"):
            _, out = simulate(setup(), command, frictionless(params(name)), cable_scale=cut)
            speed[name] = np.abs(columns(out.mvel)[:, 0]).max()
    no_load = 48.0 / 0.0603
    assert speed["power_consistent"] == pytest.approx(no_load, rel=0.01)
    assert no_load == pytest.approx(796.0, abs=0.1)  # the authors clamp at 790 rad/s
    assert speed["traj3"] > 2.0 * no_load


def test_brakes_stop_a_moving_arm_within_the_distance_of_their_torque() -> None:
    """w^2 J / 2 (tau_brake + tau_friction) of motor and reflected link, once they have gripped."""
    with jax.enable_x64(True):
        one, light = setup(), weightless(params())
        command = constant([-2500, 0, 0, 0, 0, 0, 0], 200)
        state, moving = simulate(one, command, light)
        speed = columns(moving.mvel)[-1, 0]
        _, out = simulate(one, constant([0] * N, 100), light, brakes=1, state=state)
    grips = int(np.argmax(np.asarray(out.brakes) != 0))
    at_grip, angle = columns(out.mvel)[grips - 1, 0], columns(out.mpos)[:, 0]
    inertia = POWER_CONSISTENT.actuators.inertia[0] + 12.25 * 0.2163 / transmission.TR[0] ** 2
    torque = (
        4.9
        + POWER_CONSISTENT.actuators.coulomb[0]
        + 12.25 * POWER_CONSISTENT.link_coulomb[0] / transmission.TR[0]
    )
    distance = at_grip**2 * inertia / (2.0 * torque)
    assert abs(speed) > 20.0 and abs(columns(out.mvel)[-1, 0]) < 1e-3
    # The elastic cable parts the two.
    assert abs(angle[-1] - angle[grips - 1]) == pytest.approx(distance, rel=0.35)


def test_a_force_on_the_arm_moves_it_as_far_as_its_cable_and_braked_motor_give_way() -> None:
    load, joint = 2.0, 0
    with jax.enable_x64(True):
        free = replace(weightless(params()), link_coulomb=Vec.full(N, 0.0))
        push = Vec.full(N, 0.0).replace(joint, load)
        _, out = simulate(setup(), constant([0] * N, 600), free, brakes=1, external_torque=push)
    stiffness = 2.0 * POWER_CONSISTENT.cable_stiffness[joint] * 63.095e-3**2
    moved = columns(out.jpos)[-1, joint] - HOME_JPOS[joint]
    assert moved == pytest.approx(load / stiffness, rel=0.02)
