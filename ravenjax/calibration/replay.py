"""A logged robot's closed loop on the virtual one: the same desired joints, the same controller, other mechanics.

The controller is raven2's: PID on motor angles read by encoders, counts cut to whole numbers. Where a log begins, the
robot stands at the measured joints; the time until it has forgotten that is not compared.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.estimator import LOW_PASS_INPUT, LOW_PASS_OUTPUT

JOINTS = 7


class Controller(NamedTuple):
    """PID of the seven motors, N m after the gearbox."""

    kp: Vec  # per rad
    kd: Vec  # per rad/s
    ki: Vec  # per rad s
    filtered: bool  # whether encoders pass the 120 Hz filter first, as in the fork of 2015


RAVEN2 = Controller(  # raven2: params/r2params.yaml, gold arm
    Vec((0.3, 0.3, 0.15, 0.09, 0.05, 0.05, 0.05)),
    Vec((0.008, 0.008, 0.012, 0.001, 0.0, 0.0, 0.0)),
    Vec((0.0, 0.0, 0.0, 0.05, 0.05, 0.05, 0.05)),
    filtered=False,
)
FORK2015 = RAVEN2._replace(
    kp=Vec((0.3, 0.3, 0.15, 0.09, 0.05, 0.02, 0.02)), ki=Vec((0.0, 0.0, 0.0, 0.05, 0.05, 0.0, 0.0)), filtered=True
)
CONTROLLERS = {"raven2": RAVEN2, "fork2015": FORK2015}

Replay = Callable[..., jax.Array]


def bare_rotors(params: robot.PlantParams) -> robot.PlantParams:
    """The null model of a robot: its motors with viscous friction alone. To be replayed with all `cables` cut."""
    free = Vec.full(JOINTS, 0.0)
    return replace(params, actuators=replace(params.actuators, coulomb=free, bias=free))


def replay(setup: RavenSetup, arm: ArmName, controller: Controller, cables: float = 1.0) -> Replay:
    """(parameters, first joints [7], desired joints [T, 7]) -> joints that the motors then show [T, 7]; rad and m.

    cables: times stiffness and damping of every cable; 0: bare rotors. Row t is what the encoders read after tick t, as
    a log of the next cycle has it. To be compiled and mapped. Further, of a robot that moves where the log begins: the
    first speeds of its joints [7] (rad/s and m/s), and what its controller has integrated by then [7] (motors, rad s).
    """
    tool = setup.tools[setup.arms.index(arm)]
    reading, drive = (
        signs(arm, tool, setup.software) for signs in (transmission.encoder_signs, transmission.tau_signs)
    )
    dtype = setup.precision.real

    def read(params: robot.PlantParams, state: robot.PlantState) -> jax.Array:
        counts = robot.observe(setup, arm, params, state).enc_val
        return jnp.stack(
            [(s * n).astype(dtype) * transmission.ENCODER_RAD for s, n in zip(reading, counts, strict=True)]
        )

    def run(
        params: robot.PlantParams,
        first: jax.Array,
        desired: jax.Array,
        speed: jax.Array | None = None,
        integral: jax.Array | None = None,
    ) -> jax.Array:
        def tick(carry, row):
            state, raw, smooth, integral = carry
            new = read(params, state)
            raw = jnp.stack([new, *raw[:3]])
            filtered = jnp.array(LOW_PASS_INPUT, dtype) @ raw + jnp.array(LOW_PASS_OUTPUT, dtype) @ smooth
            angle, speed = (filtered, filtered - smooth[0]) if controller.filtered else (new, new - raw[1])
            motors = jnp.stack(transmission.motor_from_joint(arm, tool, Vec(row), angle[2], setup.software))
            apart = motors - angle
            integral = integral + apart * robot.TICK_S
            kp, kd, ki = (jnp.array(tuple(gain), dtype) for gain in (controller.kp, controller.kd, controller.ki))
            torque = kp * apart - kd * speed / robot.TICK_S + ki * integral
            counts = jnp.trunc(torque * jnp.array([*transmission.COUNTS_PER_NM], dtype)).astype(jnp.int32)
            signal = robot.nominal_signal(Vec(int(s) * c for s, c in zip(drive, counts, strict=True)), jnp.int32(0))
            signal = replace(signal, cable_scale=Vec.full(JOINTS, cables))
            state, _ = robot.step(setup, arm, params, state, signal)
            angles = read(params, state)
            return (state, raw, jnp.stack([filtered, *smooth[:2]]), integral), angles

        state = robot.init(setup, arm, params, Vec(first))
        state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
        raw = jnp.stack([read(params, state)] * 4)
        if speed is not None:  # the motors stand where the log has them, the links where loaded cables leave them
            by_motors = jnp.stack(transmission.joint_from_motor(arm, tool, Vec(raw[0]), setup.software))
            state = robot.init(setup, arm, params, Vec(2.0 * first - by_motors))
            state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
            raw = jnp.stack([read(params, state)] * 4)
            mvel = transmission.motor_from_joint(arm, tool, Vec(speed), None, setup.software)
            state = replace(state, jvel=Vec(speed), mvel=mvel)
            raw = raw - jnp.stack(mvel) * robot.TICK_S * jnp.arange(4, dtype=dtype)[:, None]
        begun = jnp.zeros(JOINTS, dtype) if integral is None else integral
        _, motors = jax.lax.scan(tick, (state, raw, raw[:3], begun), desired)
        return jnp.stack([*transmission.joint_from_motor(arm, tool, Vec(motors.T), setup.software)], axis=1)

    return run
