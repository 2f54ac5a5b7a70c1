"""Simulates one control cycle of a Raven arm that follows desired joint positions.

A cycle consists of motor encoders, a PID controller of motor angles, the DAC, motors and arm.
Replays of recorded robots use this simulation. The controller is that of the software raven2. It
truncates DAC commands to whole numbers. The low-pass filter of a raven2 of 2015 is optional.
"""

from collections.abc import Callable
from typing import NamedTuple

from ravenjax import resources
from ravenjax.numbers.algebra import add, mul
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, record, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.estimator import LOW_PASS_INPUT, LOW_PASS_OUTPUT
from ravenjax.robots.raven2.stages.motor_control import gravity_torques
from ravenjax.vocabulary import TICK_S

JOINTS = 7
READINGS = 3
"""Number of past encoder readings that the low-pass filter uses."""


class Controller(NamedTuple):
    """PID of the seven motors, N m after the gearbox."""

    kp: Vec  # per rad
    kd: Vec  # per rad/s
    ki: Vec  # per rad s
    # True if a 120 Hz low-pass filter smooths the encoders, as in the modified raven2 of 2015.
    filtered: bool


CONTROLLERS = {
    name: Controller(Vec(one["kp"]), Vec(one["kd"]), Vec(one["ki"]), one["filtered"])
    for name, one in resources.read_tables(__file__, "controllers.toml").items()
}
RAVEN2, FORK2015 = CONTROLLERS["raven2"], CONTROLLERS["fork2015"]


@record
class LoopParams:
    """The parameters of a robot that a replay may change."""

    plant: robot.PlantParams
    # Time from the USB write to the motor, ms, at most Setup.command_delay. A fractional delay is a
    # weighted mean of two cycles.
    command_delay: Scalar
    # Time by which the controller's desired joints lag those of the log, ms. It is a property of
    # the log, not of the robot.
    setpoint_delay: Scalar
    cables: Scalar  # factor on stiffness and damping of every cable; 0: all cables are cut


@record
class LoopState:
    """State between two cycles."""

    plant: robot.PlantState
    readings: tuple[Vec, ...]  # motor angles, rad, latest first
    outputs: tuple[Vec, ...]  # outputs of the filter, rad, latest first; empty without a filter
    integral: Vec  # integral of the motors' errors, rad s
    commands: tuple[Vec, ...]  # DAC counts of the last Setup.command_delay cycles, latest first


class Cycle(NamedTuple):
    """Signals of one cycle."""

    angle: Vec  # rad, motors as the controller reads them
    speed: Vec  # rad/s
    counts: Vec  # DAC, as written to USB


def params(plant: robot.PlantParams) -> LoopParams:
    """Return parameters of a loop without a delay and with intact cables."""
    return LoopParams(plant, 0.0, 0.0, 1.0)


def bare_rotors(params: robot.PlantParams) -> robot.PlantParams:
    """Return the null model: motors with only viscous friction, to be replayed with cut cables."""
    free = Vec.full(JOINTS, 0.0)
    return replace(params, actuators=replace(params.actuators, coulomb=free, bias=free))


def start_state(
    setup: RavenSetup, controller: Controller, plant: robot.PlantState, whole_counts: bool = True
) -> LoopState:
    """Return the state of a robot at rest, with zero integrals in the controller. `whole_counts`:
    True for motor angles in whole encoder counts, False for exact angles.
    """
    zero = Vec(jnp.asarray(0.0, setup.precision.real) for _ in range(JOINTS))
    # At rest, all past readings are equal, and the low-pass filter's past outputs equal them.
    history = (read_encoders(setup, plant, whole_counts),) * READINGS
    return LoopState(
        plant=plant,
        # Without the filter, the controller uses only the last reading, for the speed.
        readings=history if controller.filtered else history[:1],
        outputs=history if controller.filtered else (),
        integral=zero,
        commands=(zero,) * setup.command_delay,
    )


def read_encoders(setup: RavenSetup, plant: robot.PlantState, whole_counts: bool) -> Vec:
    """Return motor angles in rad: in whole encoder counts if `whole_counts`, else exact."""
    dtype = setup.precision.real
    # An angle is the sum of the count at the reference, count_ref, and the motion since then.
    turned = Vec(robot.drives.angle_in_radians(motor, dtype) for motor in plant.motors)
    counts = Vec(
        (motor.count + ref).astype(dtype)
        for motor, ref in zip(plant.motors, plant.count_ref, strict=True)
    )
    if whole_counts:
        return counts * transmission.ENCODER_RAD
    return turned + plant.count_ref.map(lambda ref: ref.astype(dtype) * transmission.ENCODER_RAD)


def advance_cycle(
    setup: RavenSetup,
    arm: ArmName,
    controller: Controller,
    params: LoopParams,
    state: LoopState,
    desired: Callable[[Scalar], Vec],
    written: Callable[[Vec], Vec] | None = None,
    whole_counts: bool = True,
) -> tuple[LoopState, robot.PlantOutput, Cycle]:
    """Compute one control cycle of 1 ms. `desired`: returns the desired motor angles (rad) for the
    measured angle of the insertion motor. `written`: returns DAC counts that replace those of the
    controller. `whole_counts`: encoders and DAC use whole counts.
    """
    tool = setup.tools[setup.arms.index(arm)]
    new = read_encoders(setup, state.plant, whole_counts)
    angle, before = (
        (_low_passed(new, state), state.outputs[0])
        if controller.filtered
        else (new, state.readings[0])
    )
    speed = (angle - before) / TICK_S
    error = desired(angle[2]) - angle
    integral = state.integral + error * TICK_S
    torque = error.map(mul, controller.kp) - speed.map(mul, controller.kd)
    torque = torque.map(add, integral.map(mul, controller.ki))
    if setup.software == "raven2":
        jpos = transmission.joint_from_motor(arm, tool, angle, setup.software)
        # raven2 compensates gravity at the first three joints.
        lift = gravity_torques(setup, arm, jpos)
        torque = Vec((*(Vec(torque[:3]) + lift), *torque[3:]))
    counts = torque * transmission.COUNTS_PER_NM * transmission.tau_signs(arm, tool, setup.software)
    counts = counts.map(jnp.trunc) if whole_counts else counts
    counts = counts if written is None else written(counts)
    arriving = _arriving(params.command_delay, counts, state.commands)
    cable_scale = Vec.full(JOINTS, params.cables)
    signal = robot.PlantSignal(arriving, jnp.int32(0), cable_scale=cable_scale)
    plant, out = robot.step(setup, arm, params.plant, state.plant, signal)
    after = LoopState(
        plant=plant,
        readings=(new, *state.readings[:-1]),
        outputs=(angle, *state.outputs[:-1]) if controller.filtered else (),
        integral=integral,
        commands=(counts, *state.commands)[: setup.command_delay],
    )
    return after, out, Cycle(angle, speed, counts)


def _low_passed(new: Vec, state: LoopState) -> Vec:
    # Applies the velocity filter: a weighted sum of new value, earlier inputs and earlier outputs.
    gains = (*LOW_PASS_INPUT[1:], *LOW_PASS_OUTPUT)
    total = new * LOW_PASS_INPUT[0]
    for gain, past in zip(gains, (*state.readings, *state.outputs), strict=True):
        total = total + past * gain
    return total


def _arriving(delay: Scalar, now: Vec, before: tuple[Vec, ...]) -> Vec:
    """Return the DAC counts that reach the motors in this cycle. A delay of 1.3 ms gives 0.7 times
    the counts of one cycle ago plus 0.3 times those of two cycles ago. before: latest first.
    """
    if not before:
        return now
    delay = jnp.clip(delay, 0.0, float(len(before)))
    shares = [jnp.maximum(1.0 - jnp.abs(delay - ticks), 0.0) for ticks in range(len(before) + 1)]
    total = now * shares[0]
    for share, then in zip(shares[1:], before, strict=True):
        total = total + then * share
    return total
