"""Contact: force against depth as Hertz has it, statics, friction's cone, action and reaction,
energy never made.
"""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import quickly
from plant_runs import N, columns, energy, frictionless, weightless

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import instrument, scene, transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import contact, robot
from ravenjax.robots.raven2.plant.coupling import arm_coupling
from ravenjax.robots.raven2.setup import RavenSetup

TOUCH = contact.ContactParams()
HERTZ = 16.0 / 9.0 * 12.5e3 * np.sqrt(2e-3)  # N/m^1.5: 4/3 E / (1 - 0.5^2) sqrt(R)
STILL = Vec.full(N, 0.0)
PRESS = np.array([0, 0, 15, 0, 0, 0, 0])  # DAC counts
CLOSED = (*HOME_JPOS[:5], 0.0, 0.0)
ARMS: tuple[ArmName, ...] = ("gold", "green")


def numbers(values) -> Vec:
    return Vec(jnp.asarray(float(x)) for x in values)


def at_depth(depth_m: float, jaws: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """Joints of the gold arm with jaw tip 1 so deep in the tissue, by the insertion alone."""
    jpos = np.array([*HOME_JPOS[:3], roll, HOME_JPOS[4], jaws, jaws], float)
    for _ in range(20):
        tip, _ = instrument.jaw_tips("gold", numbers(jpos))
        surface = scene.tissue_surface("gold", tip.position)
        jpos[2] += (depth_m - float(surface.depth)) / -float(tip.project_on_joints(surface.rise)[2])
    return jpos


@quickly.jit
def felt(touched, jpos, jvel):
    tips = contact.jaw_tips("gold", touched, Vec(jpos), Vec(jvel), 1e-3)
    return [(c.present_force(), c.rise, c.normal, c.drag, c.velocity, c.vessel) for c in tips]


def tip_contact(jpos, jvel=(0.0,) * N):
    with jax.enable_x64(True):
        found = felt(
            jax.tree.map(jnp.float64, TOUCH), jnp.asarray(jpos, float), jnp.asarray(jvel, float)
        )
        return jax.tree.map(np.asarray, found)[0]


@pytest.mark.parametrize("depth_mm", [0.0, 0.01, 0.5, 1.0, 2.0])
def test_force_against_depth_is_that_of_hertz(depth_mm) -> None:
    with jax.enable_x64(True):
        jpos = at_depth(depth_mm / 1e3)
    force, rise, *_ = tip_contact(jpos)
    np.testing.assert_allclose(
        force, HERTZ * (depth_mm / 1e3) ** 1.5 * np.array(rise), rtol=1e-6, atol=1e-12
    )


def test_pressing_is_harder_leaving_softer_and_nothing_pulls() -> None:
    with jax.enable_x64(True):
        jpos = at_depth(2e-3)
    normal = {}
    for speed in (0.2, 0.02, 0.0, -0.02):
        _, rise, law, _, velocity, _ = tip_contact(jpos, [0, 0, speed, 0, 0, 0, 0])
        normal[float(-np.dot(rise, velocity))] = law
    slow, still, fast = sorted(normal)[1:]
    assert normal[slow].force < normal[still].force < normal[fast].force
    for closing in (slow, still, fast):
        depth = 2e-3 + 1e-3 * closing
        np.testing.assert_allclose(
            normal[closing].force, HERTZ * depth**1.5 * (1 + 15.0 * closing), rtol=1e-6
        )
    leaving = min(normal)
    assert leaving < -1 / 15.0 and normal[leaving].force == normal[leaving].rate == 0.0


def test_friction_stays_in_its_cone_and_opposes_sliding() -> None:
    rng = np.random.default_rng(0)
    with jax.enable_x64(True):
        poses = [
            at_depth(depth, 0.3, roll) for depth, roll in ((1e-3, 0.0), (3e-3, 0.6), (2e-3, -0.9))
        ]
    for jpos in poses * 20:
        jvel = rng.normal(size=N) * np.array([0.1, 0.1, 0.02, 0.5, 0.5, 0.5, 0.5])
        force, rise, law, *_, velocity, _ = tip_contact(jpos, jvel)
        force, unit, velocity = (
            np.array(force),
            np.array(rise) / np.linalg.norm(rise),
            np.array(velocity),
        )
        along = force - unit * (unit @ force)
        assert np.linalg.norm(along) <= 0.2 * (unit @ force) * (1 + 1e-9)
        assert along @ (velocity - unit * (unit @ velocity)) <= 0.0
        assert unit @ force >= 0.0 and law.rate >= 0.0


# --- over time ---


@cache
def stepper(arms: tuple[ArmName, ...], ticks: int):
    one = RavenSetup(arms=arms, tools=("r_grasper",) * len(arms), precision=REFERENCE)

    def run(params, states, touched, command):
        load = robot.PlantSignal(Vec(command), jnp.int32(0))

        def tick(states, _):
            stages = {"contact": touched}
            moved = robot.step_all(one, params, states, (load,) * len(arms), stages)
            return tuple(new for new, _ in moved), tuple(out for _, out in moved)

        return jax.lax.scan(tick, states, None, length=ticks)

    return one, quickly.jit(run)


def simulate(arms, ticks, params, states, command=(0,) * N, touched=TOUCH):
    _, run = stepper(arms, ticks)
    touched = jax.tree.map(lambda x: jnp.float64(x), touched)
    return jax.tree.map(np.asarray, run(params, states, touched, jnp.asarray(command, jnp.int32)))


def begun(arms, jpos, jvel, change=lambda p: p):
    """Parameters and state of passive arms at those joints and speeds, motors turning with them."""
    one, params, states = stepper(arms, 1)[0], [], []
    for arm, q, v in zip(arms, jpos, jvel, strict=True):
        own = change(weightless(robot.params(one, arm)))
        own = replace(
            jax.tree.map(jnp.float64, replace(own, noise_key=0.0)), noise_key=own.noise_key
        )
        state = robot.init(one, arm, own, numbers(q))
        state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)), jvel=numbers(v))
        params.append(own)
        coupling = arm_coupling(arm, "r_grasper", "raven2")
        states.append(replace(state, mvel=numbers(coupling.to_motors(Vec(map(float, v))))))
    return tuple(params), tuple(states)


def undamped(params):
    return replace(frictionless(params), cable_damping=Vec.full(N, 0.0))


def toward(arm: ArmName, way) -> np.ndarray:
    """Joint speeds at which the closed jaws go along a way in the world, m/s, by the first three
    joints.
    """
    tip, _ = instrument.jaw_tips(arm, numbers(CLOSED))
    columns_ = np.array([[*map(float, column)] for column in tip.columns[:3]]).T
    return np.array(
        [
            *np.linalg.solve(columns_, np.array(scene.frame0_in_world(arm)[1]).T @ np.array(way)),
            0,
            0,
            0,
            0,
        ]
    )


def stored(arm: ArmName, jpos: np.ndarray) -> np.ndarray:
    """Energy in the tissue, J, at joints [T, 7]: 2/5 k d^2.5 of each jaw tip."""

    @quickly.jit
    def deep(q):
        def depths(row):
            tips = instrument.jaw_tips(arm, Vec(row))
            return jnp.stack([scene.tissue_surface(arm, tip.position).depth for tip in tips])

        return jax.vmap(depths)(q)

    return 0.4 * HERTZ * (np.maximum(np.asarray(deep(jnp.asarray(jpos))), 0.0) ** 2.5).sum(axis=1)


@pytest.mark.slow
def test_pressed_with_a_known_motor_torque_the_arm_comes_to_rest_where_statics_say() -> None:
    """The tissue's force on the joints is what the cables carry, and the cables carry the
    motors' torque.
    """
    with jax.enable_x64(True):
        params, states = begun(("gold",), [at_depth(0.5e-3)], [STILL])
        smooth = replace(TOUCH, friction=0.0)
        # All motors but the insertion's stand still.
        hard = Vec(0.0 if i == 2 else 100.0 for i in range(N))
        motor = replace(params[0].actuators, coulomb=hard, viscous=Vec.full(N, 0.005))
        held = replace(
            params[0],
            actuators=motor,
            link_coulomb=Vec.full(N, 0.0),
            link_viscous=Vec((0.5,) * 3 + (0.005,) * 4),
        )
        _, (out,) = simulate(
            ("gold",), 3000, (jax.tree.map(jnp.float64, held),), states, PRESS, smooth
        )
        jpos, force = columns(out.jpos)[-1], columns(out.touch.force)[-1]
        assert np.abs(columns(out.jvel)[-1]).max() < 0.05 and np.linalg.norm(force) > 0.1
        tips = instrument.jaw_tips("gold", numbers(jpos))
        surfaces = [scene.tissue_surface("gold", tip.position) for tip in tips]
        each = [
            HERTZ * max(float(s.depth), 0.0) ** 1.5 * np.array([*map(float, s.rise)])
            for s in surfaces
        ]
        np.testing.assert_allclose(force, sum(each), rtol=5e-2)
        load = np.sum(
            [
                np.array([float(np.dot(c, f)) for c in np.array(t.columns, float)])
                for t, f in zip(tips, each, strict=True)
            ],
            axis=0,
        )
        torque = Vec(
            a * t
            for a, t in zip(transmission.CABLE_PER_MOTOR, columns(out.tension)[-1], strict=True)
        )
        coupling = arm_coupling("gold", "r_grasper", "raven2")
        pulled = np.array([*map(float, coupling.joint_loads(torque))])
        np.testing.assert_allclose(pulled, -load, rtol=5e-2, atol=3e-2 * np.abs(load[:3]).max())
        counts = held.actuators.torque_per_count[2] * 15
        carried = (
            held.actuators.reaction_scale[2]
            * transmission.CABLE_PER_MOTOR[2]
            * columns(out.tension)[-1, 2]
        )
        lost = 0.005 * columns(out.mvel)[-1, 2]  # the motor still creeps
        np.testing.assert_allclose(abs(carried + lost), counts, rtol=5e-2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_an_arm_that_bounces_and_slides_on_tissue_never_gains_energy(seed) -> None:
    """Links, motors, cables and tissue together, in each tick, from a random state above the
    tissue.
    """
    rng = np.random.default_rng(seed)
    with jax.enable_x64(True):
        jpos = at_depth(-rng.uniform(0, 2e-3), rng.uniform(0, 0.5), rng.uniform(-1, 1))
        speed = rng.normal(size=N) * np.array([0.1, 0.1, 0.0, 0.5, 0.5, 0.5, 0.5])
        speed[2] = -rng.uniform(0.02, 0.1)
        params, states = begun(("gold",), [jpos], [speed], undamped)
        _, (out,) = simulate(("gold",), 300, params, states)
        assert np.asarray(out.touch.tissue).max() > 0.05
        total = energy(params[0], out) + stored("gold", columns(out.jpos))
    assert np.diff(total).max() < 1e-5 * total[0]
    assert total[-1] < total[0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_two_arms_that_collide_push_each_other_alike_and_gain_no_energy(seed) -> None:
    rng = np.random.default_rng(seed)
    with jax.enable_x64(True):
        jpos = [np.array(CLOSED, float), np.array(CLOSED, float)]
        to_the_other = [rng.uniform(0.1, 0.2), *rng.uniform(-0.03, 0.03, 2)]
        speeds = [toward("gold", to_the_other), toward("green", [-0.15, 0.0, 0.0])]
        params, states = begun(ARMS, jpos, speeds, undamped)
        nothing = replace(TOUCH, tissue_modulus=0.0)
        _, outs = simulate(ARMS, 300, params, states, touched=nothing)
        force = np.asarray(outs[0].touch.instrument)
        np.testing.assert_array_equal(force, outs[1].touch.instrument)
        assert force.max() > 1.0 and force.min() == 0.0
        world = [
            columns(out.touch.force) @ np.array(scene.frame0_in_world(arm)[1]).T
            for arm, out in zip(ARMS, outs, strict=True)
        ]
        np.testing.assert_allclose(world[0], -world[1], atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(world[0], axis=1), force, atol=1e-9)
        total = np.sum([energy(p, out) for p, out in zip(params, outs, strict=True)], axis=0)
        apart = force == 0.0
        assert total[apart][1:].max() <= total[0] * (1 + 1e-6)
        assert (np.diff(total[apart]) < 1e-5 * total[0]).all()
