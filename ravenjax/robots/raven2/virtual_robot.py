"""The virtual robot alone: DAC commands and output pins in, encoders and the pins of the PLC out.

    robot = VirtualRobot()
    reading = robot.step(dac, output_pins)
    reading.encoders, reading.pins, reading.signals.tip

It is the part of the tick after the USB boards (PLC, brakes, motors, cables, links, encoders),
without faults. Every operation is one IEEE operation in float32, and functions such as the sine are
those of the system's C library (`engines.cpu.transition`). The code that `ravenjax export` writes
gives the same bits on any CPU. Engines of campaigns fuse operations, so their last digits differ.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu.memory import aligned_buffer
from ravenjax.engines.cpu.transition import Memory, RecordKind, StateTransition, write_row
from ravenjax.numbers import Scalar, Vec, for_each_arm, jnp, record, run_eagerly, tree
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup, map_arms
from ravenjax.robots.raven2.software import inputs as checked
from ravenjax.robots.raven2.software.code import TransitionCode
from ravenjax.robots.raven2.stages import plc


@record
class RobotParams:
    """Parameters of the robot, set before it runs."""

    plc: plc.PlcParams
    arms: PerArm[plant.PlantParams]


@record
class RobotState:
    """State of the robot from one millisecond to the next."""

    plc: plc.PlcState
    arms: PerArm[plant.PlantState]


@record
class RobotInputs:
    """Inputs of the robot in one millisecond."""

    dac: PerArm[Vec]  # 7 int32 counts, as written to USB
    output_pins: Scalar  # int32 byte to the PLC: run level (bits 0, 1), FP (2), READY (3), wave (4)
    estop_button: Scalar  # int32, 1: pressed
    start_button: Scalar  # int32, 1: pressed


@record
class RobotSignals:
    """Outputs of the robot after a millisecond, and its true motion."""

    encoders: PerArm[Vec]  # 7 int32 counts, as unpacked from USB
    pins: Scalar  # int32 byte of the PLC, bits 6 and 7: run level; the same on each board
    runlevel: Scalar  # int32, of the PLC
    brakes: Scalar  # int32, 1: commanded on
    mpos: PerArm[Vec]  # 7 rad, true motor positions
    mvel: PerArm[Vec]  # 7 rad/s
    jpos: PerArm[Vec]  # 7 rad; insertion m, true joints of the links
    jvel: PerArm[Vec]  # 7 rad/s; insertion m/s
    tip: PerArm[Vec]  # 3 m in registered frame 0, true tip


def params(setup: RavenSetup, parameter_set: str = parameter_sets.DEFAULT) -> RobotParams:
    """Return the default parameters, as plain numbers. parameter_set: a `parameter_sets.Name`."""
    set_names = for_each_arm(setup, parameter_set)
    return RobotParams(plc.PlcParams(), map_arms(setup, plant.params, set_names))


def begin_robot(
    setup: RavenSetup, params: RobotParams, start: PerArm[Vec], level: Scalar
) -> tuple[RobotState, RobotSignals]:
    """Return state and signals of a robot at rest at joints `start` (rad, m). level: run level."""
    arms = map_arms(setup, plant.init, params.arms, start)
    state = RobotState(plc.init(setup, level), arms)
    responses = map_arms(setup, plant.observe_robot, params.arms, arms)
    level = jnp.int32(level)
    relays = plc.PlcOutput(level, plc.brakes_commanded(level))
    return state, _signals(setup, params, state, relays, responses)


def step(
    setup: RavenSetup, params: RobotParams, state: RobotState, inputs: RobotInputs
) -> tuple[RobotState, RobotSignals]:
    """Return state and signals of the robot after one millisecond of PLC and mechanics."""
    estop, start = inputs.estop_button != 0, inputs.start_button != 0
    plc_inputs = plc.PlcSignal((inputs.output_pins,), estop, start)
    plc_state, relays = plc.step(setup, params.plc, state.plc, plc_inputs)
    plant_inputs = tuple(plant.PlantSignal(counts, relays.brakes) for counts in inputs.dac)
    stepped = plant.step_all(setup, params.arms, state.arms, plant_inputs)
    arm_states, arm_outputs = zip(*stepped, strict=True)
    state = RobotState(plc_state, arm_states)
    return state, _signals(setup, params, state, relays, arm_outputs)


def _signals(
    setup: RavenSetup,
    params: RobotParams,
    state: RobotState,
    relays: plc.PlcOutput,
    outputs: PerArm[plant.PlantOutput],
) -> RobotSignals:
    # Returns the signals of a robot in this state, from the outputs of its PLC and arms.
    return RobotSignals(
        encoders=tuple(output.enc_val for output in outputs),
        pins=plc.input_pins(state.plc.runlevel),
        runlevel=relays.runlevel,
        brakes=relays.brakes,
        **control.columns_of(outputs, "mpos", "mvel", "jpos", "jvel"),
        tip=plant.true_tips(setup, params.arms, state.arms, outputs),
    )


@functools.lru_cache(maxsize=8)
def robot_code(setup: RavenSetup) -> TransitionCode:
    """Return the code of a robot with this setup. The transition named "robot" is `step`."""
    # Only the types of these numbers matter; their values are arbitrary
    parameters, zero = plain_numbers(params(setup)), np.int32(0)
    inputs = RobotInputs(for_each_arm(setup, Vec.full(7, zero)), zero, zero, zero)
    home = for_each_arm(setup, plain_numbers(HOME_JPOS))
    with run_eagerly():
        state, signals = begin_robot(setup, parameters, home, level=zero)
    records = {"params": parameters, "state": state, "inputs": inputs, "signals": signals}
    kinds = {name: RecordKind.of(record) for name, record in records.items()}
    arguments = [kinds[name] for name in ("params", "state", "inputs")]
    shapes = (kind.shapes() for kind in arguments)
    program, _ = traced.trace_function(functools.partial(step, setup), *shapes, functions="library")
    transition = StateTransition(program, *(kind.layout for kind in arguments))
    return TransitionCode({"robot": transition}, kinds)


def plain_numbers(record: Any) -> Any:
    """Return the record with float32 in place of each float, and int32 of each integer."""

    def convert(x: Any) -> Any:
        number = np.asarray(x)
        types: dict[str, Any] = {"f": np.float32, "i": np.int32}
        return number.astype(types.get(number.dtype.kind, number.dtype))[()]

    return tree.map_leaves(convert, record)


@dataclasses.dataclass(frozen=True)
class Reading:
    """The outputs of one millisecond."""

    encoders: np.ndarray  # int32 [arms, 7] counts, as `ControlSoftware.step` takes them
    pins: int  # byte of the PLC, the same on each board
    signals: RobotSignals  # the robot's signals, with its true motion


class VirtualRobot:
    """The hardware of a Raven-II behind its USB boards: PLC, brakes, motors, cables, links,
    encoders.

    One `step` is one millisecond. The robot starts at rest with the brakes on. The gold arm comes
    before the green arm. Joints are in the order shoulder, elbow, insertion, tool_roll, wrist,
    grasp1, grasp2. `reading` contains the outputs of the last step or, before the first step, those
    of the start state.
    """

    def __init__(
        self,
        arms: Sequence[ArmName] = ("gold", "green"),
        tools: Sequence[str] | None = None,
        parameter_set: str = parameter_sets.DEFAULT,
        jpos: Any = None,
        runlevel: int = run_levels.E_STOP,
    ):
        """Prepare the robot in its start state.

        `tools`: one per arm, by default those of raven2. `parameter_set`: mechanical parameters.
        `jpos`: joints [arms, 7] in rad and m at the start, by default the home pose. `runlevel`:
        run level of the PLC at the start, 0 to 3. Raises UserError.
        """
        arm_names = checked.arm_names(arms)
        checked.parse_word("parameter_set", parameter_set, get_args(parameter_sets.Name))
        level = checked.parse_whole_number("runlevel", runlevel, 0, 3)
        tool_names = checked.tool_names(tools, arm_names, "raven2")
        self.setup = RavenSetup(arms=arm_names, tools=tool_names)
        start_jpos = [HOME_JPOS] * len(arm_names) if jpos is None else jpos
        start_jpos = checked.parse_joints(start_jpos, len(arm_names))
        self.code = robot_code(self.setup)
        kinds = self.code.kinds
        self.params = plain_numbers(params(self.setup, parameter_set))
        start = tuple(plain_numbers(Vec(joints)) for joints in start_jpos)
        with run_eagerly():
            state, signals = begin_robot(self.setup, self.params, start, np.int32(level))
        self.reading = self._reading(signals)
        self._inputs = aligned_buffer(1, kinds["inputs"].layout.bytes)
        self._out = aligned_buffer(1, kinds["signals"].layout.bytes)
        self._state = kinds["state"].row(state)
        memory = Memory(kinds["params"].row(self.params), self._state, self._inputs, self._out)
        self._step = self.code.machine.bind("robot", memory)

    def step(
        self, dac: Any, output_pins: int, estop_button: bool = False, start_button: bool = False
    ) -> Reading:
        """Compute one millisecond, and return the outputs of the robot after it.

        `dac`: whole counts [arms, 7], as `Output.dac`. `output_pins`: the byte that the control
        software wrote. Raises UserError for a wrong argument; the state is then unchanged.
        """
        counts = checked.parse_counts("dac", dac, (len(self.setup.arms), 7))
        pins = checked.parse_whole_number("output_pins", output_pins, 0, 255)
        estop = checked.parse_flag("estop_button", estop_button)
        start = checked.parse_flag("start_button", start_button)
        numbers = [*counts.flat, pins, estop, start]
        write_row(self.code.kinds["inputs"].layout, self._inputs[0], numbers)
        self._step()
        self.reading = self._reading(self.code.kinds["signals"].read(self._out[0]))
        return self.reading

    @property
    def state(self) -> RobotState:
        """The state of the robot after the last millisecond."""
        return self.code.kinds["state"].read(self._state)

    def _reading(self, signals: RobotSignals) -> Reading:
        return Reading(np.array(signals.encoders, np.int32), int(signals.pins), signals)
