"""The virtual robot: rest, friction, brakes, energy, convergence to a stiff ODE solver, float32,
faults.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from plant_runs import N, columns, constant, energy, frictionless, setup, simulate, weightless
from scipy.integrate import solve_ivp

from ravenjax.numbers.setup import CAMPAIGN, REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import drives, robot
from ravenjax.robots.raven2.plant.parameter_sets import parameter_set

RAD_PER_COUNT = 2 * math.pi / 4000
POSE_A = Vec(np.radians(x) if i != 2 else 0.30 for i, x in enumerate((15, 60, 0, -40, 20, 30, 50)))
LEVELS = {  # N m after the gearbox, at which a motor breaks away
    "traj3": np.array([0.04055, 0.071925, 0.0511, 0.006, 0.006, 0.006, 0.006]),
    "power_consistent": np.array([0.0254, 0.0782, 0.0607, 0.0244, 0.0085, 0.0223, 0.0162]),
}


# --- consistency ---


@pytest.mark.parametrize("arm", ["gold", "green"])
@pytest.mark.parametrize("software", ["raven2", "fork2015"])
@pytest.mark.parametrize("jpos0", [HOME_JPOS, POSE_A])
def test_encoders_links_and_control_software_agree_at_rest(arm, software, jpos0) -> None:
    with jax.enable_x64(True):
        one = setup(arm, software=software)
        params = weightless(robot.params(one, arm))
        state = robot.init(one, arm, params, jpos0)
        out = robot.observe_robot(one, arm, params, state)
        signs = np.array(transmission.encoder_signs(arm, "r_grasper", software))
        measured = signs * np.array(out.enc_val) * RAD_PER_COUNT
        expected = np.array(
            transmission.motor_from_joint(arm, "r_grasper", jpos0, software=software)
        )
        assert np.abs(measured - expected).max() <= 0.5001 * RAD_PER_COUNT
        np.testing.assert_allclose(np.array(out.mpos), expected, atol=1e-9)
        np.testing.assert_allclose(np.array(out.jpos), np.array(jpos0, float), atol=1e-12)


# --- friction and brakes ---


@pytest.mark.slow
@pytest.mark.parametrize("precision", [REFERENCE, CAMPAIGN])
@pytest.mark.parametrize("parameter_set", LEVELS)
def test_below_breakaway_nothing_creeps_and_above_it_moves(precision, parameter_set) -> None:
    one, levels = setup(precision=precision), LEVELS[parameter_set]
    with jax.enable_x64(precision.needs_x64):
        params = weightless(robot.params(one, "gold", parameter_set))
        params = replace(params, actuators=replace(params.actuators, bias=Vec.full(N, 0.0)))
        motor = params.actuators
        signs = np.array(transmission.tau_signs("gold", "r_grasper"))
        per_count = signs * np.array(motor.torque_per_count) * np.array(motor.gain)
        below = np.trunc(0.98 * levels / per_count).astype(np.int32)
        _, out = simulate(one, constant(below, 1000), params)
        # rad of motor, of which an encoder count is 1.6e-3
        assert np.abs(columns(out.mpos)[-1] - columns(out.mpos)[0]).max() < 2e-4
        assert np.abs(columns(out.mvel)[10:]).max() < 1e-6

        ratio = np.array(transmission.TR)
        link = np.array(motor.reaction_scale) * np.array(params.link_coulomb) / ratio
        for joint in range(N):
            above = np.zeros(N)
            above[joint] = 1.05 * (levels + link)[joint] / per_count[joint]
            _, out = simulate(one, constant(np.ceil(np.abs(above)) * np.sign(above), 300), params)
            moved = columns(out.mpos)[-1] - columns(out.mpos)[0]
            assert moved[joint] > 5e-3, (joint, moved)


# --- accuracy ---

WAVE_HZ = np.array([1.1, 1.7, 1.3, 2.1, 2.9, 2.3, 3.1])
WAVE_CNT = np.array([1500, 1500, 1500, 500, 400, 400, 400])


def wave(ticks: int) -> np.ndarray:
    return (WAVE_CNT * np.sin(2 * np.pi * WAVE_HZ * np.arange(ticks)[:, None] * 1e-3)).astype(
        np.int32
    )


def by_a_stiff_solver(commands: np.ndarray, params: robot.PlantParams, start: Vec) -> np.ndarray:
    """Joint positions after each tick, from the equations as written in (m, q), without dry
    friction.
    """
    matrix = np.array(transmission.motor_matrix("gold", "r_grasper"))
    signs = np.array(transmission.tau_signs("gold", "r_grasper"))
    motor, arm = params.actuators, np.array(transmission.CABLE_PER_MOTOR)
    per_count = signs * np.array(motor.torque_per_count) * np.array(motor.gain)
    inertia, viscous, share = (
        np.array(x) for x in (motor.inertia, motor.viscous, motor.reaction_scale)
    )
    stiffness, damping = np.array(params.cable_stiffness), np.array(params.cable_damping)
    link_viscous = np.array(params.link_viscous)

    @jax.jit
    def links(q, v):
        mass, bias = link_dynamics.mass_matrix_and_bias("gold", Vec(q), Vec(v), params.gravity)
        return jnp.array([list(row) for row in mass]), jnp.stack(bias)

    def slope(_, x, drive):
        m, q, w, v = np.split(x, 4)
        stretch, rate = arm * (m - matrix @ q), arm * (w - matrix @ v)
        force = arm * (stiffness * (np.exp(stretch) - np.exp(-stretch)) + 2 * damping * rate)
        mass, bias = links(q, v)
        acceleration = np.linalg.solve(mass, matrix.T @ force - bias - link_viscous * v)
        return np.concatenate([w, v, (drive - viscous * w - share * force) / inertia, acceleration])

    x = np.concatenate([matrix @ np.array(start), np.array(start, float), np.zeros(2 * N)])
    found = []
    for row in commands:
        drive = per_count * row + np.array(motor.bias)
        x = solve_ivp(slope, (0, 1e-3), x, "Radau", args=(drive,), rtol=1e-7, atol=1e-9).y[:, -1]
        found.append(x[N : 2 * N])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(("parameter_set", "share"), [("traj3", 0.02), ("power_consistent", 0.06)])
def test_halving_the_step_halves_the_distance_to_a_stiff_solver(parameter_set, share) -> None:
    """The fitted friction slows the roll's rotor within 10 ms, of which the implicit step errs
    by half of its own.
    """
    with jax.enable_x64(True):
        params = robot.params(setup(), "gold", parameter_set)
        params = replace(
            weightless(params),
            link_coulomb=Vec.full(N, 0.0),
            actuators=replace(weightless(params).actuators, coulomb=Vec.full(N, 0.0)),
        )
        commands = wave(80)
        exact = by_a_stiff_solver(commands, params, HOME_JPOS)
        distance = []
        for substeps in (1, 2):
            _, out = simulate(setup(substeps=substeps), commands, params)
            distance.append(np.sqrt(np.mean((columns(out.jpos) - exact) ** 2, axis=0)))
    travel = np.ptp(exact, axis=0)
    assert (distance[0] < share * travel).all(), (distance[0], travel)
    ratio = distance[0] / distance[1]
    assert (ratio > 1.7).all() and (ratio < 2.3).all(), ratio


def test_energy_is_never_made() -> None:
    """Coasting without friction, damping or gravity: the step only loses energy, and little of
    the slow motion's.
    """
    with jax.enable_x64(True):
        one = setup()
        params = replace(weightless(robot.params(one, "gold")), cable_damping=Vec.full(N, 0.0))
        state, _ = simulate(one, wave(200), params)
        _, out = simulate(one, constant([0] * N, 400), frictionless(params), state=state)
        total = energy(params, out)
        assert total[0] > 1e-2
        assert (np.diff(total) < 1e-6 * total[0]).all()
        assert total[-1] > 0.9 * total[50]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameter_set", "largest", "share"), [("traj3", 1, 0.1), ("power_consistent", 2, 0.12)]
)
def test_float32_and_float64_stay_together_for_three_seconds(parameter_set, largest, share) -> None:
    commands = wave(3000)
    with jax.enable_x64(True):
        _, exact = simulate(setup(), commands, robot.params(setup(), "gold", parameter_set))
    single = setup(precision=CAMPAIGN)
    _, single = simulate(single, commands, robot.params(single, "gold", parameter_set))
    counts = np.abs(columns(single.enc_val) - columns(exact.enc_val))
    assert counts.max() <= largest and (counts != 0).mean() < share
    assert np.abs(columns(single.jpos) - columns(exact.jpos)).max() < 2e-5
    assert single.jpos[0].dtype == np.float32 and single.enc_val[0].dtype == np.int32


def test_the_motor_angle_keeps_tiny_increments() -> None:
    """0.01 rad/s at 900 rad for 10 s in float32: plain accumulation would not move at all."""

    def creep(angle, _):
        return drives.advance_angle(angle, jnp.float32(1e-5)), None

    start = drives.advance_angle(drives.REFERENCE, jnp.float32(899.6370423253))
    end, _ = jax.jit(lambda angle: jax.lax.scan(creep, angle, None, length=10_000))(start)
    turned = (
        int(end.count) - int(start.count) + float(end.fraction) - float(start.fraction)
    ) * RAD_PER_COUNT
    np.testing.assert_allclose(turned, 0.1, rtol=1e-4)
    assert float(jnp.float32(899.637) + jnp.float32(1e-5)) == float(jnp.float32(899.637))


# --- faults, noise, form ---


def test_mechanical_faults_act_where_they_say() -> None:
    with jax.enable_x64(True):
        one = setup()
        params = weightless(robot.params(one, "gold"))
        commands = constant([-1500, 0, 0, 0, 0, 0, 0], 200)

        def moved(**scales) -> np.ndarray:
            return columns(simulate(one, commands, params, **scales)[1].jpos)[-1] - np.array(
                HOME_JPOS
            )

        ones = Vec.full(N, 1.0)
        healthy = moved()
        assert healthy[0] > 0.02
        assert abs(moved(torque_scale=ones.replace(0, 0.0))[0]) < 1e-6
        # The motor turns, the link does not follow.
        assert abs(moved(cable_scale=ones.replace(0, 0.0))[0]) < 1e-3
        assert moved(friction_scale=ones.replace(0, 5.0))[0] < 0.7 * healthy[0]
        pushed = columns(
            simulate(
                one, commands, params, brakes=1, external_torque=Vec.full(N, 0.0).replace(1, 4.0)
            )[1].jpos
        )
        # 3.8 N m beyond friction on 1115 N m/rad of cable.
        assert 2e-3 < pushed[-1, 1] - HOME_JPOS[1] < 5e-3


@pytest.mark.slow
def test_hard_stops_hold_a_runaway_joint() -> None:
    with jax.enable_x64(True):
        params = weightless(robot.params(setup(), "gold"))
        _, out = simulate(setup(), constant([-6000, 6000, -6000, 0, 0, 0, 0], 2000), params)
        jpos, upper, lower = (
            columns(out.jpos),
            np.array(params.stops.upper),
            np.array(params.stops.lower),
        )
        assert jpos[-1, 0] > upper[0] and jpos[-1, 1] < lower[1] and jpos[-1, 2] > upper[2]
        beyond = np.maximum(jpos - upper, 0) + np.maximum(lower - jpos, 0)
        assert (beyond.max(axis=0)[:3] < (0.006, 0.006, 0.006)).all()
        assert np.abs(columns(out.jvel)[-1, :3]).max() < 1e-2


@pytest.mark.slow
def test_noise_only_where_asked_for_and_with_its_size() -> None:
    one = setup(precision=CAMPAIGN, noise=True)
    params = replace(robot.params(one, "gold"), encoder_noise=3.0, noise_key=jnp.uint32(7))
    commands = constant([0] * N, 2000)
    _, noisy = simulate(one, commands, params, brakes=1)
    _, quiet = simulate(setup(precision=CAMPAIGN), commands, params, brakes=1)
    error = columns(noisy.enc_val) - columns(quiet.enc_val)
    np.testing.assert_allclose(error.std(axis=0), 3.0, rtol=0.08)
    assert np.abs(np.corrcoef(error.T) - np.eye(N)).max() < 0.1
    other = replace(params, noise_key=jnp.uint32(8))
    assert (
        columns(simulate(one, commands, other, brakes=1)[1].enc_val) != columns(noisy.enc_val)
    ).mean() > 0.5


def test_published_sets_have_their_published_numbers() -> None:
    active, base = parameter_set("traj3"), parameter_set("B")
    motor = active.actuators
    input_bias = np.array((-0.0479807114, -0.06273207, 0.01564328))
    for numbers, published in (
        (motor.torque_per_count, (2.737629663234212e-4,) * 3),
        (motor.coulomb, (0.04055, 0.071925, 0.0511)),
        (motor.viscous, (2.47e-3, 2.43e-3, 2.84e-3)),
        (active.cable_stiffness, (720e3, 176e3, 9.25e3)),
        (active.link_viscous, (0.00505, 0.00245, 0.0053)),
        (motor.bias, -input_bias * motor.gain[:3]),
        (parameter_set("matlab_main").cable_damping, (1000, 1656, 560)),
        (parameter_set("matlab_global").cable_stiffness, (720e3, 264e3, 9.25e3)),
        (base.actuators.coulomb, (8.11e-2, 4.11e-2, 5.11e-2)),
        (base.cable_damping, (4000, 1380, 400)),
    ):
        np.testing.assert_allclose(numbers[:3], published, rtol=1e-6)
