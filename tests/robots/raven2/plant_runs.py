"""The virtual robot by itself, under rows of DAC commands: what tests of its mechanics share."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import quickly

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import parameter_sets, robot
from ravenjax.robots.raven2.setup import RavenSetup

N = 7
CAPSTAN_M, TORQUE_PER_COUNT = 5.675e-3, 0.0603 * 12.25 / 2730.0
POWER_CONSISTENT = parameter_sets.parameter_set("power_consistent")
FRICTION_N = (
    POWER_CONSISTENT.actuators.coulomb[0] + abs(POWER_CONSISTENT.actuators.bias[0])
) / CAPSTAN_M
CHUNK = 20  # ticks a compiled call: one compile serves runs of any length


def setup(arm: str = "gold", precision=REFERENCE, **other) -> RavenSetup:
    return RavenSetup(arms=(arm,), precision=precision, **other)


@cache
def stepper(setup_: RavenSetup):
    """A compiled scan over DAC rows; parameters and initial state are traced, so one compile
    serves all tests.
    """
    arm = setup_.arms[0]

    def tick(carry, row):
        params, state, brakes, scales = carry
        command = Vec(row[i] for i in range(N))
        state, out = robot.step(
            setup_, arm, params, state, robot.PlantSignal(command, brakes, *scales)
        )
        return (params, state, brakes, scales), out

    @quickly.jit
    def run(params, state, brakes, scales, commands):
        (_, state, *_), out = jax.lax.scan(tick, (params, state, brakes, scales), commands)
        return state, out

    return run


def simulate(setup_, commands, params=None, jpos0=HOME_JPOS, brakes=0, state=None, **scales):
    params = params or robot.params(setup_, setup_.arms[0])
    dtype = setup_.precision.real
    as_real = lambda x: jnp.asarray(x, dtype)  # noqa: E731
    key = params.noise_key
    params = replace(jax.tree.map(as_real, replace(params, noise_key=0.0)), noise_key=key)
    if state is None:
        state = robot.init(setup_, setup_.arms[0], params, jpos0)
        if not brakes:
            state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
    ones = Vec.full(N, 1.0)
    given = [scales.get(k, ones) for k in ("torque_scale", "cable_scale", "friction_scale")]
    given.append(scales.get("external_torque", Vec.full(N, 0.0)))
    found = []
    assert len(commands) % CHUNK == 0
    for rows in np.split(np.asarray(commands, np.int32), len(commands) // CHUNK):
        state, out = stepper(setup_)(
            params, state, jnp.int32(brakes), jax.tree.map(as_real, given), rows
        )
        found.append(jax.tree.map(np.asarray, out))
    return state, jax.tree.map(lambda *parts: np.concatenate(parts), *found)


def columns(vec) -> np.ndarray:
    return np.stack(vec, axis=-1)


def constant(counts, ticks: int) -> np.ndarray:
    return np.tile(np.asarray(counts, np.int32), (ticks, 1))


def swings() -> np.ndarray:
    """0.2 s of DAC rows that swing every motor, each in its own time."""
    pattern = np.array([1500, -1500, 1500, 800, -800, 800, -800])
    ticks = np.arange(200)[:, None]
    return (
        pattern * np.sin(2 * np.pi * ticks / np.array([200, 160, 120, 90, 80, 100, 70]))
    ).astype(np.int32)


def weightless(params: robot.PlantParams) -> robot.PlantParams:
    """No gravity and no bias: nothing moves by itself."""
    return replace(
        params,
        gravity=Vec((0.0, 0.0, 0.0)),
        actuators=replace(params.actuators, bias=Vec.full(N, 0.0)),
    )


def frictionless(params: robot.PlantParams) -> robot.PlantParams:
    return replace(params, friction_scale=0.0)


def energy(params: robot.PlantParams, out) -> np.ndarray:
    """Kinetic energy of links and motors and elastic energy of cables (J), in the equation's own
    metric.
    """
    motor, arm = params.actuators, np.array(transmission.CABLE_PER_MOTOR)

    @jax.jit
    @jax.vmap
    def of_links(q, v):
        mass, _ = link_dynamics.mass_matrix_and_bias("gold", Vec(q), Vec(v), params.gravity)
        return 0.5 * v @ jnp.array([list(row) for row in mass]) @ v

    links = of_links(columns(out.jpos), columns(out.jvel))
    share = np.array(motor.inertia) / np.array(motor.reaction_scale)
    motors = 0.5 * (columns(out.mvel) ** 2 * share).sum(axis=1)
    springs = (
        2 * np.array(params.cable_stiffness) * (np.cosh(arm * columns(out.stretch)) - 1)
    ).sum(axis=1)
    return np.asarray(links) + motors + springs
