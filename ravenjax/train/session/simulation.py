"""Simulates a session's robots: the driven robot, its golden run, and the virtual robot."""

import dataclasses
import operator
from collections.abc import Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.faults import table
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.engines import trace_key
from ravenjax.engines.cpu.stepper import StepCode, Stepper
from ravenjax.errors import UserError
from ravenjax.faults.fault import Faults, FaultSlot
from ravenjax.numbers import tree
from ravenjax.numbers.algebra import minus, norm
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, replace
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.robots.raven2.console.packet import empty_packet
from ravenjax.robots.raven2.loop import observers, run, tick
from ravenjax.robots.raven2.loop.records import Input
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import monitor
from ravenjax.train.protocol import GOLDEN, Frame, FrameLayout, Json
from ravenjax.train.robot import E_STOP, Packet
from ravenjax.vocabulary.effects import TRIGGER_CODES

SPARE_MS = 60_000
"""Extra rows of the motion table, for ticks after the session's end and for repeated packets."""
OLDER_PACKETS: dict[str, Sequence[str]] = {"console": (), "hand": (), "network": ("lost",)}
"""Sites on the console's side of the network, and their channels that need no older packets."""
SOURCE = Path(__file__).read_bytes()
"""Part of the key of compiled code in the cache: this module affects the compiled code."""


@dataclasses.dataclass(frozen=True, eq=False)
class Blueprint:
    """The compiled code and the plan of a session, from which robots are made."""

    plan: Plan
    layout: FrameLayout
    code: StepCode
    # Inputs of the compiled code at the start: varied parameters, and faults without effect.
    inputs: Any

    @property
    def setup(self) -> RavenSetup:
        """The settings that determine the compiled code."""
        return self.plan.program.setup

    @property
    def fault_slots(self) -> int:
        """Number of fault slots of a hazard. The slot of the E-stop button follows them."""
        return self.setup.injection.slots - 1


def make_blueprint(
    config: CampaignConfig, packets: bool = False, limit_mm: float = LIMIT_MM
) -> Blueprint:
    """Compile the session that `config` describes; its duration is the session's. packets: packets
    come from outside, at most one a tick. Raises UserError if a hazard then needs older packets.
    limit_mm: of the observer. The campaign's limit does not change, because run ids depend on it.
    """
    session_plan = plan.make_plan(config)
    program = session_plan.program
    injection = program.setup.injection
    slots = injection.slots + 1
    for use in injection.sites if packets else ():
        for _, channel in use.channels:
            if use.site in OLDER_PACKETS and channel not in OLDER_PACKETS[use.site]:
                raise UserError(
                    f"a hazard acts at site {use.site!r}, channel {channel!r}, before the"
                    " network. A robot in its own process simulates only what follows the network."
                    " Remove the hazard from the robot's scenario, or train without --robot"
                )
    setup = replace(program.setup, injection=replace(injection, slots=slots))
    monitored = replace(program.params.monitor, limit=limit_mm / 1e3)
    params = replace(program.params, monitor=monitored)
    program = dataclasses.replace(program, setup=setup, params=params)
    session_plan = dataclasses.replace(session_plan, program=program)
    layout = FrameLayout.of(setup.arms)
    # Varied parameters of the last row, the E-stop button, which is no hazard.
    estop_parameters = [values[-1] for values in session_plan.varied.values()]
    zeros = {name: np.zeros((), dtype) for name, dtype in table.ARRAYS.items()}
    # The tick divides by the period, so it is never 0.
    empty = FaultSlot(**(zeros | {"period": np.ones((), np.int32)}))
    inputs = estop_parameters, Faults((empty,) * slots)
    entering = (
        [np.float32(0.0)] * run.series_length(setup),
        np.bool_(False),
        empty_packet(setup) if packets else None,
    )
    columns = len(session_plan.columns)
    length = 1 if packets else config.campaign.ticks + SPARE_MS

    def begin(inputs) -> tick.TickState:
        return run.init(setup, program.params_of(inputs[0]))

    def step(
        inputs, state: tick.TickState, now: Scalar, entering, motion
    ) -> tuple[tick.TickState, list[Scalar]]:
        varied, faults = inputs
        # Written by `SimulatedRobot`: the golden run's signals, whether it differs, and a packet.
        series, golden_differs, packet = entering
        signal = Input(now, motion, run.reference_from(setup, series), packet, golden_differs)
        params = program.params_of(varied)
        after, signals = tick.advance_tick(setup, params, faults, state, signal)
        frame = _frame(setup, params, now, after, signals, signal)
        return after, [jnp.float32(x) for x in (*frame, *run.reference_series(setup, signals))]

    def finish(inputs, state: tick.TickState) -> dict[str, Scalar]:
        return run.outcomes(setup, program.params_of(inputs[0]), state)

    compile_cache.enable_cache()
    tables, cache = (length,) * columns, compile_cache.object_cache()
    key = trace_key.hash_values(
        "session", SOURCE, setup, params, program.module, program.varied, packets
    )
    code = StepCode(begin, step, finish, inputs, entering, tables, cache, key)
    return Blueprint(session_plan, layout, code, inputs)


def _frame(
    setup: RavenSetup,
    params: tick.TickParams,
    now: Scalar,
    state: tick.TickState,
    out: tick.TickSignals,
    signal: tick.Input,
) -> list[Scalar]:
    """Return the channels [simulated] of `channels.toml`, in order, then [simulated_arm] by arm."""
    active_fault = reduce(operator.or_, out.fault_active, jnp.bool_(False))
    software, observer = out.control, state.monitor
    has_cue = reduce(operator.or_, (cue.force[0] > 0.0 for cue in out.haptics), jnp.bool_(False))
    live = observers.is_live(software.runlevel, state.control.state_machine.soft_estopped)
    numbers = [now, software.runlevel, software.surgeon_mode, software.soft_estopped, as_int(live)]
    numbers += [out.plc.runlevel, out.plc.brakes]
    histories = run.check_histories(setup, state).values()
    trips = sum((history.count for history in histories), jnp.int32(0))
    numbers += [software.last_seq, as_int(active_fault), trips, out.tip_distance * 1e3]
    # halted_ms, golden_halted_ms and golden_cue. The last two are the robot's own numbers until a
    # golden run differs. `SimulatedRobot.step` then replaces them with those of the golden run.
    numbers += [observer.halted, observer.halted, as_int(has_cue)]
    positions = run.measured_tips(setup, software)
    golden = observers.golden_reference(setup, signal, out.tip, positions)
    for i, measured in enumerate(software.arms):
        cue, position = out.haptics[i], positions[i]
        position_m = (jnp.float32(x) * 1e-6 for x in position)
        force = (x * cue.force[0] for x in cue.direction)
        numbers += [*measured.jpos, *measured.jpos_d, *measured.mpos, *measured.mvel]
        numbers += [*out.plant[i].jpos, *out.nominal[i].jpos]
        numbers += [*out.tip[i], *out.nominal[i].tip_position, *position_m]
        # error_mm, force and dac.
        numbers += [cue.distance * 1e3, *force, *measured.current_cmd_written]
        distances = monitor.arm_distances(
            params.monitor, observer.arms[i], out.nominal[i].tip_position, position, golden.pos[i]
        )
        # depth_mm to false_report_mm, then known_mm.
        numbers += [out.depth[i] * 1e3, *hazard_distances(live, distances)]
        numbers += [norm(minus(Vec(jnp.float32(x) for x in position), golden.pos[i])) * 1e-3]
        # contact, vessel_n and between_n. Without [contact] there is no touch.
        touch = out.plant[i].touch
        numbers += [0.0] * 5 if touch is None else [*touch.force, touch.vessel, touch.instrument]
    return numbers


def hazard_distances(live: Scalar, distances: monitor.Distances) -> list[Scalar]:
    """Return unintended_mm, unintended_off_mm, loss_mm and false_report_mm of a frame. They are 0
    while not live; unintended_off_mm is 0 while live. distances: m.
    """
    # Factors from m to mm, or 0.
    while_live = jnp.where(live, 1e3, 0.0)
    return [
        distances.unintended * while_live,
        distances.unintended_off * (1e3 - while_live),
        distances.loss * while_live,
        distances.false_report * while_live,
    ]


def write_numbers(inputs: Sequence[np.ndarray], numbers: Sequence[Any]) -> None:
    """Write numbers into the first inputs of compiled code. Each input is an array of one number,
    and inputs beyond the numbers keep their values.
    """
    for array, number in zip(inputs[: len(numbers)], numbers, strict=True):
        array[0] = number


_FIELDS = tuple(field.name for field in dataclasses.fields(FaultSlot))
HISTORY_MS = 2000
"""The oldest packet that a fault may repeat, ms; `copy_from` copies the motion of this time."""


class SimulatedRobot:
    """A simulated robot and its golden run. `row` contains the robot's channels after each `step`.
    While no fault is armed, robot and golden run are identical, and only the robot is computed.
    """

    def __init__(self, blueprint: Blueprint):
        self.blueprint = blueprint
        code = blueprint.code
        self._robot = Stepper(code, blueprint.inputs)
        # Both use the same motion table.
        self._golden = Stepper(code, blueprint.inputs, self._robot.flat)
        # Row 0: of the robot. Row 1: of the golden run.
        self._outputs = np.zeros((2, code.outputs), np.float32)
        self._robot_address, self._golden_address = (out.ctypes.data for out in self._outputs)
        self.row = self._outputs[0, : blueprint.layout.simulated]
        # [columns, ticks], filled row by row.
        self.motion = self._robot.flat.reshape(len(code.tables), -1)
        first, last = (blueprint.layout.places[name] for name in (GOLDEN[0], GOLDEN[-1]))
        # Channels of the golden run in the robot's output, and in that of the golden run.
        self._shown_golden, self._computed_golden = self._outputs[:, first.start : last.stop]
        self.next_tick = 0
        # The golden run's signals follow the frame in its output. Inputs of the robot's tick are
        # these signals, then `_golden_differs`, then the packet.
        self._golden_output = self._outputs[1, blueprint.layout.simulated :]
        series = self._golden_output.size
        self._golden_input = self._robot.step_inputs[:series]
        self._golden_differs = False
        self._golden_differs_input = self._robot.step_inputs[series]
        self.packets = [each.step_inputs[series + 1 :] for each in (self._robot, self._golden)]
        """Where a packet from outside enters the robot and its golden run."""
        self._initial_state = self._robot.snapshot()
        # The state of the tick with the index of each leaf in place of its value.
        indices = tree.fill_tree(code.state.record, list(range(len(code.state.layout.types))))
        self._slot_leaves = [tree.tree_leaves(slot) for slot in indices.faults.slots]
        # The fields of all slots are the last inputs of the compiled code.
        slot_inputs = len(_FIELDS) * (blueprint.fault_slots + 1)
        self._first_fault_input = len(code.inputs.layout.types) - slot_inputs

    def step(self) -> None:
        """Compute one tick: the golden run, if it differs, and then the robot."""
        if self._golden_differs:
            self._golden.step(self.next_tick, self._golden_address)
            # The golden run's signals are inputs of the robot's tick, which compares them.
            write_numbers(self._golden_input, self._golden_output.tolist())
        self._robot.step(self.next_tick, self._robot_address)
        if self._golden_differs:
            self._shown_golden[:] = self._computed_golden
        self.next_tick += 1

    def outcomes(self) -> Json:
        """Return the robot's outcome columns of a campaign, as far as they are known now."""
        return self._robot.outcomes()

    def golden_outcomes(self) -> Json:
        """Return the outcome columns of the golden run, in which the armed fault does not act."""
        return (self._golden if self._golden_differs else self._robot).outcomes()

    reports_arrive = True  # Whether reports of the robot arrive: always for a simulated robot

    def stand_by(self) -> None:
        """Restart the motion table of a waiting robot, which is at its start position."""
        self.reset()

    def reset(self) -> None:
        """Return to the start: homed, at rest, pedal up, no fault armed."""
        self.disarm()
        for robot in (self._robot, self._golden):
            robot.begin()
        self.next_tick = 0

    def copy_from(self, other: "SimulatedRobot") -> None:
        """Copy the state of another robot of the same blueprint, without its faults."""
        self.disarm()
        self._robot.restore(other._robot.snapshot())
        self._golden.restore(other._golden.snapshot())
        self._set_golden_differs(other._golden_differs)
        # A fault may repeat packets of the last `HISTORY_MS`, so their motion is copied, too.
        begin = max(0, other.next_tick - HISTORY_MS)
        self.motion[:, begin : other.next_tick] = other.motion[:, begin : other.next_tick]
        self._outputs[:] = other._outputs
        self.next_tick = other.next_tick

    def _realign_golden(self):
        """Let the golden run continue from the robot's state, because a past hazard may have
        separated them. Distances from the golden run then count from here.
        """
        realign = monitor.realign_golden
        self._robot.change(lambda state: replace(state, monitor=realign(state.monitor)))
        self._golden.restore(self._robot.snapshot())

    def _set_golden_differs(self, differs: bool):
        self._golden_differs = differs
        # Compiled code reads -1, all bits set, as True.
        self._golden_differs_input[0] = -int(differs)

    def arm(self, row: int) -> None:
        """Activate the faults of this row of the fault table from the next tick on. The first acts
        at once, or with the next packet; the others keep their distances in time. No fault waits
        for the pedal.
        """
        plan, slots = self.blueprint.plan, range(self.blueprint.fault_slots)
        # A slot without a fault has code 0.
        used = [slot for slot in slots if plan.faults["code"][row, slot]]
        first = min((int(plan.faults["start"][row, slot]) for slot in used), default=0)
        for slot in slots:
            values = {name: column[row, slot] for name, column in plan.faults.items()}
            # Faults of packets start by the packet's number, which is 1 in tick 0.
            by_packet = values["trigger"] == TRIGGER_CODES["packet"]
            values["trigger"] = TRIGGER_CODES["packet" if by_packet else "time"]
            values["start"] = self.next_tick + by_packet + int(values["start"]) - first
            self._set_fault(slot, values if slot in used else None)
        # The first inputs of the compiled code are the varied parameters.
        write_numbers(self._robot.inputs, [values[row] for values in plan.varied.values()])
        self._realign_golden()
        self._set_golden_differs(True)

    def disarm(self) -> None:
        """Remove the faults and parameters that `arm` and `press_estop` set."""
        # The last slot is that of the E-stop button.
        for slot in range(self.blueprint.fault_slots + 1):
            self._set_fault(slot, None)
        # The first inputs of the compiled code are the varied parameters.
        initial_parameters, _ = self.blueprint.inputs
        write_numbers(self._robot.inputs, initial_parameters)
        self._realign_golden()
        self._set_golden_differs(False)

    def press_estop(self, row: int) -> None:
        """Hold the E-stop button for 100 ms. row: the button's row of the fault table."""
        # In the golden run nobody presses the button. From now on, the golden run therefore differs
        # from the robot and must be computed, too. It starts in the present state of the robot.
        if not self._golden_differs:
            self._golden.restore(self._robot.snapshot())
            self._set_golden_differs(True)
        # The pressed button is a fault: slot 0 of its row. It acts in the slot after the hazards'.
        button = {name: column[row, 0] for name, column in self.blueprint.plan.faults.items()}
        button |= {"trigger": TRIGGER_CODES["time"], "start": self.next_tick, "duration": 100}
        self._set_fault(self.blueprint.fault_slots, button)

    def _set_fault(self, slot: int, values: Json | None):
        """Set a slot's fault (values None: no fault), and reset the state of the slot."""
        first = self._first_fault_input + slot * len(_FIELDS)
        # Without a fault, all fields are 0 but the period, which the tick divides by.
        fields = {name: name == "period" for name in _FIELDS} if values is None else values
        write_numbers(self._robot.inputs[first:], [fields[name] for name in _FIELDS])
        self._robot.restore_leaves(self._initial_state, self._slot_leaves[slot])


class EstopHold:
    """Freezes the nominal model of a stopped robot in its frames. The nominal model receives the
    console's packets. If the operator keeps the pedal down after an E-stop, the model moves
    hundreds of millimetres away from the stopped robot, and the cue reaches its cap. So the frames
    show the model's pose at the first tick of an E-stop, the robot's or its software's, until the
    robot restarts. The error is then the distance of the measured tip from this pose. The force is
    zero, because a hand cannot move a robot that holds its brakes. The page, the hand and the
    recording get these frames. The tick itself is the same as in campaigns.
    """

    # Channels of the models in the first tick of the E-stop; None: the robot is not stopped.
    _held: dict[str, np.ndarray] | None = None

    def apply(self, frame: Frame) -> None:
        """In an E-stop of robot or software, hold the model's pose in the frame. Set the error to
        the distance of the measured tip from this pose, and the force to 0.
        """
        if not (frame["runlevel"] == E_STOP or frame["soft_estopped"]):
            self._held = None
            return
        arms = frame.layout.arms
        if self._held is None:
            names = [f"{arm}/{name}" for arm in arms for name in ("model_jpos", "model_tip")]
            self._held = {name: frame[name].copy() for name in names}
        for name, numbers in self._held.items():
            frame[name] = numbers
        for arm in arms:
            difference = frame[f"{arm}/position"] - frame[f"{arm}/model_tip"]
            frame[f"{arm}/error_mm"] = 1e3 * np.linalg.norm(difference)
            frame[f"{arm}/force"] = 0.0


class PacketRobot(SimulatedRobot):
    """A simulated robot that gets packets over a network: call `tick` once a millisecond."""

    def __init__(self, config: CampaignConfig):
        """Raises UserError if a hazard of `config` acts on the console's side of the network."""
        super().__init__(make_blueprint(config, packets=True))
        self.arms = self.blueprint.setup.arms
        self.frame = Frame(self.blueprint.layout)
        self._estop_hold = EstopHold()

    def tick(self, packet: Packet | None) -> Frame:
        """Compute one tick with a packet or None. Return the same `Frame` object each time."""
        for entering in self.packets:
            # Without a packet, only its flag "received" changes. It is the first leaf.
            write_numbers(entering, [0] if packet is None else tree.tree_leaves(packet))
        self.step()
        self.frame.row[: self.row.size] = self.row
        self._estop_hold.apply(self.frame)
        return self.frame
