"""What a sudden command and a push do to the virtual robot, beside what statics of motor, gear
and drum say.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import authors, nominal, power_consistent, published, robot
from ravenjax.robots.raven2.setup import RavenSetup

SETUP = RavenSetup(arms=("gold",), precision=REFERENCE)
COUNTS, LOAD_NM, TICKS = 10_000, 2.0, 1500
CAPSTAN_M, PULLEY_M = authors.CAPSTAN_M, authors.LINK_RADIUS[0]  # of the shoulder
KP = nominal.KP[0]  # N m per rad of motor, after the gearbox


class Statics(NamedTuple):
    """Of the shoulder."""

    who: str
    tension: float  # N, pressed on its stop by COUNTS
    peak: float  # N, on the way there
    torque: float  # N m at the joint
    speed: float  # rad/s, largest of the motor
    given_way: float  # mm of 0.3 m of arm, pushed by LOAD_NM while its controller holds it


def of_robot(name: str) -> Statics:
    """The virtual robot with the set `name`; needs 64 bits."""
    params = robot.params(SETUP, "gold", name)
    sign = transmission.tau_signs("gold", "r_grasper", "raven2")
    pressed = _run(params, int(-sign[0]) * COUNTS, 0.0, 0.0)
    pushed, rest = (_run(params, 0, KP, load) for load in (LOAD_NM, 0.0))
    tension = np.abs(pressed[0])
    return Statics(
        f"virtual robot, {name}",
        float(tension[-1]),
        float(tension.max()),
        float(tension[-1]) * PULLEY_M,
        float(np.abs(pressed[1]).max()),
        float(pushed[2][-1] - rest[2][-1]) * 300.0,
    )


def by_hand() -> Statics:
    """Motor torque through gear and drum; 48 V by the back EMF; the controller's stiffness at
    the joint.
    """
    torque = COUNTS * published.CONTROLLER_TORQUE_PER_COUNT
    ratio = transmission.TR[0]
    stiffness = KP * ratio**2 / transmission.GEARBOX[0]
    spring = 2.0 * published.parameter_set("traj3").stiffness[0] * PULLEY_M**2
    gives = LOAD_NM / stiffness + LOAD_NM / spring
    return Statics(
        "statics, without friction",
        torque / CAPSTAN_M,
        np.nan,
        torque * PULLEY_M / CAPSTAN_M,
        power_consistent.SUPPLY_V / transmission.TORQUE_PER_AMP[0],
        gives * 300.0,
    )


def _run(
    params: robot.PlantParams, counts: int, kp: float, load: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cable tension (N), motor speed (rad/s) and joint (rad) of the shoulder, [TICKS], with a
    spring at the motors.
    """
    drive = transmission.tau_signs("gold", "r_grasper", "raven2")
    state = robot.init(SETUP, "gold", params, Vec(HOME_JPOS))
    state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
    start = robot.observe(SETUP, "gold", params, state).mpos
    push = Vec.full(7, 0.0).replace(0, load)

    def tick(state, _):
        angles = robot.observe(SETUP, "gold", params, state)
        torques = [
            kp * (a - b) - 0.027 * kp * v
            for a, b, v in zip(start, angles.mpos, angles.mvel, strict=True)
        ]
        spring = [
            torque * per_nm
            for torque, per_nm in zip(torques, transmission.COUNTS_PER_NM, strict=True)
        ]
        command = [
            int(s) * jnp.trunc(c).astype(jnp.int32) for s, c in zip(drive, spring, strict=True)
        ]
        command[0] = command[0] + counts
        signal = replace(robot.nominal_signal(Vec(command), jnp.int32(0)), external_torque=push)
        state, out = robot.step(SETUP, "gold", params, state, signal)
        return state, (out.tension[0], out.mvel[0], out.jpos[0])

    _, rows = jax.jit(lambda one: jax.lax.scan(tick, one, None, length=TICKS))(state)
    tension, speed, jpos = map(np.asarray, rows)
    return tension, speed, jpos
