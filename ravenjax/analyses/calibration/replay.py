"""A logged robot's closed loop on the virtual one: the same desired joints, the same controller,
other mechanics.

Where a log begins, the robot stands at the measured joints; the time until it has forgotten that is
not compared.
"""

from __future__ import annotations

from collections.abc import Callable

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import JOINTS, Controller
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

Replay = Callable[..., jax.Array]


def bare_rotors(params: robot.PlantParams) -> robot.PlantParams:
    """The null model of a robot: its motors with viscous friction alone. To be replayed with all
    `cables` cut.
    """
    free = Vec.full(JOINTS, 0.0)
    return replace(params, actuators=replace(params.actuators, coulomb=free, bias=free))


def replay(setup: RavenSetup, arm: ArmName, controller: Controller, cables: float = 1.0) -> Replay:
    """(parameters, first joints [7], desired joints [T, 7]) -> joints that the motors then show [T,
    7]; rad and m.

    cables: times stiffness and damping of every cable; 0: bare rotors. Row t is what the encoders
    read after tick t, as a log of the next cycle has it. To be compiled and mapped. Further, of a
    robot that moves where the log begins: the first speeds of its joints [7] (rad/s and m/s), and
    what its controller has integrated by then [7] (motors, rad s).
    """
    tool = setup.tools[setup.arms.index(arm)]

    def run(
        params: robot.PlantParams,
        first: jax.Array,
        desired: jax.Array,
        speed: jax.Array | None = None,
        integral: jax.Array | None = None,
    ) -> jax.Array:
        loop = replace(position_loop.params(params), cables=cables)

        def tick(state: position_loop.LoopState, row: jax.Array):
            def motors(insertion: jax.Array) -> Vec:
                return transmission.motor_from_joint(arm, tool, Vec(row), insertion, setup.software)

            state, _, _ = position_loop.cycle(setup, arm, controller, loop, state, motors)
            return state, jnp.stack(position_loop.readings(setup, arm, state.plant))

        state = _released(robot.init(setup, arm, params, Vec(first)))
        mvel = None
        if (
            speed is not None
        ):  # the motors stand where the log has them, the links where loaded cables leave them
            read = position_loop.readings(setup, arm, state)
            by_motors = jnp.stack(transmission.joint_from_motor(arm, tool, read, setup.software))
            state = _released(robot.init(setup, arm, params, Vec(2.0 * first - by_motors)))
            mvel = transmission.motor_from_joint(arm, tool, Vec(speed), None, setup.software)
            state = replace(state, jvel=Vec(speed), mvel=mvel)
        begun = None if integral is None else Vec(integral)
        start = position_loop.start(setup, arm, controller, state, mvel, begun)
        _, motors = jax.lax.scan(tick, start, desired)
        return jnp.stack(
            [*transmission.joint_from_motor(arm, tool, Vec(motors.T), setup.software)], axis=1
        )

    return run


def _released(state: robot.PlantState) -> robot.PlantState:
    return replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
