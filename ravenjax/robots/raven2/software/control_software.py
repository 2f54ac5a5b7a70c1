"""Runs the control software alone: encoders, packets, PLC pins in; DAC commands, output pins out.

    software = ControlSoftware(tools=("r_grasper", "r_grasper"))
    output = software.step(encoders, packet=datagram, pins=0b11 << 6)
    output.dac[0], output.output_pins, output.signals.runlevel

The code is that of the control software in campaigns. It computes in the original's arithmetic
(float32 stored, float64 for intermediate results) and order (`original.literal`), so every number
equals the original's. It runs as machine code, or one operation at a time in Python, with the same
bits (`engines.cpu.transition`).

Homing is not simulated. The start state at a pose is that of the original after an E-stop in that
pose, so the first pedal-down commands the present pose. One number may differ from the original's:
the accumulated jaw opening. The original resets this opening only if it differs by more than 45 deg
from the jaw (raven2: local_io.cpp).
"""

# Callers may pass anything, and JAX is typed in part.
# pyright: reportUnnecessaryIsInstance=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# pyright: reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu.memory import aligned_buffer
from ravenjax.engines.cpu.transition import Memory, RecordKind
from ravenjax.errors import UserError, format_value
from ravenjax.numbers import Vec, replace
from ravenjax.numbers.setup import ORIGINAL, Precision
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console.packet import SIZE_BYTES, Packet
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import ArmName, RavenSetup
from ravenjax.robots.raven2.software import inputs as checked
from ravenjax.robots.raven2.software.code import ARITHMETICS, Output, Outputs, software_code
from ravenjax.robots.raven2.software.rows import InputRows
from ravenjax.robots.raven2.stages import overdrive
from ravenjax.robots.raven2.stages.estimator import RAD_PER_COUNT

Datagram = bytes | bytearray | memoryview


class ControlSoftware:
    """Raven-II control software that runs one millisecond per `step`.

    It starts as if homing had just completed, in cartesian mode. raven2 starts in run level 0 and
    waits for the PLC. The 2015 fork starts in pedal-down, because its simulator builds have no PLC.
    The gold arm comes before the green one. Joints are in the order shoulder, elbow, insertion,
    tool_roll, wrist, grasp1, grasp2.

    The start pose is the home pose, or the pose given by `jpos`, `encoders` or `state`. If the
    robot is in another pose, pass one of these arguments. Otherwise the first pedal-down moves the
    jaws to the opening of the home pose, unless the measured opening differs from it by more than
    45 deg (as in the original).
    """

    def __init__(
        self,
        software: Literal["raven2", "fork2015"] = "raven2",
        arms: Sequence[ArmName] = ("gold", "green"),
        tools: Sequence[str] | None = None,
        policy: Literal["no_regulation", "soft_regulation", "hard_regulation"] = "soft_regulation",
        level: str | None = None,
        enc_offset: Any = 0,
        console: Literal["increments", "absolute"] = "increments",
        runlevel: int | None = None,
        params: Callable[[control.ControlParams], control.ControlParams] | None = None,
        precision: Precision = ORIGINAL,
        jpos: Any = None,
        encoders: Any = None,
        state: control.ControlState | None = None,
        arithmetic: Literal["compiled", "interpreted"] = "compiled",
    ) -> None:
        """Prepare the control software in its start state.

        `tools`: one per arm, by default those of the software. `level`: an overdrive level
        ("beginner", "moderate", "advanced", "fork2015"). `enc_offset`: encoder counts at motor
        angle 0, a number, [7] or [arms, 7]. `runlevel`: the run level at the start, 0 to 3.
        `params`: changes any other parameter. `precision`: number widths other than the original's.

        At most one of these three sets the start pose. `jpos`: joints [arms, 7] in rad and m,
        rounded to encoder counts. `encoders`: counts [arms, 7] as for `step`. `state`: the `state`
        of another instance, which continues with the same bits. `arithmetic`: "interpreted" gives
        the same bits, 100 times slower. Raises UserError.
        """
        checked.parse_word("software", software, DEFAULT_TOOLS)
        checked.parse_word("policy", policy, overdrive.POLICIES)
        checked.parse_word("console", console, SIZE_BYTES)
        checked.parse_word("arithmetic", arithmetic, ARITHMETICS)
        if level is not None:
            checked.parse_word("level", level, overdrive.LEVELS)
        if runlevel is not None:
            runlevel = checked.parse_whole_number("runlevel", runlevel, 0, 3)
        if not isinstance(precision, Precision):
            got = format_value(precision)
            raise UserError(f"precision is {got}, expected a ravenjax.Precision")
        starts = {"jpos": jpos, "encoders": encoders, "state": state}
        given = [name for name, value in starts.items() if value is not None]
        if len(given) > 1:
            raise UserError(
                f"{' and '.join(given)} are given, expected only one of {', '.join(starts)}:"
                " each of them sets the start"
            )
        if state is not None and runlevel is not None:
            raise UserError(
                f"runlevel is {runlevel}, but the argument state contains a run level; pass only"
                " one of them"
            )
        names = checked.arm_names(arms)
        self.setup = setup = RavenSetup(
            arms=names,
            software=software,
            tools=checked.tool_names(tools, names, software),
            console=console,
            precision=precision,
        )
        offsets = checked.parse_counts("enc_offset", enc_offset, (len(names), 7), (7,), ())
        with traced.x64_context(setup):
            defaults = control.params(setup)
            counts = np.broadcast_to(offsets, (len(names), 7))
            self.params = replace(
                defaults,
                overdrive=overdrive.params(setup, level, overdrive.POLICIES.index(policy)),
                estimator=tuple(
                    replace(e, enc_offset=Vec(map(np.int32, o)))
                    for e, o in zip(defaults.estimator, counts, strict=True)
                ),
            )
            """The present parameters."""
            if params is not None:
                self.params = _change_params(self.params, params)
            initial = control.init(setup, runlevel=runlevel)
        if jpos is not None:
            encoders = _encoders_at(setup, self.params, checked.parse_joints(jpos, len(names)))
        if encoders is not None:
            encoders = checked.parse_counts(given[0], encoders, (len(names), 7))
        if state is not None:
            initial = checked.record_like("state", state, initial)
        kinds = RecordKind.of(self.params), RecordKind.of(initial)
        self.code = software_code(setup, *kinds, arithmetic)
        """The programs of the software and their records, for the C library."""
        if encoders is not None:
            machine = replace(initial.state_machine, runlevel=np.int32(run_levels.E_STOP))
            self._take_memory(replace(initial, state_machine=machine))
            output = self.step(encoders)
            initial = _at_measured_pose(initial, self.state, output.signals)
        self._take_memory(initial)

    def _take_memory(self, initial: control.ControlState) -> None:
        # Allocates this instance's memory, and binds the compiled functions to it.
        kinds = self.code.kinds
        self._state, self._row = kinds["state"].row(initial), InputRows(self.setup)
        self._out = aligned_buffer(1, kinds["signals"].layout.bytes)
        self._written: control.ControlSignals = kinds["signals"].views(self._out[0])
        self._fixed = kinds["params"].row(self.params)
        memory = Memory(self._fixed, self._state, self._row.bytes, self._out)
        bind = self.code.machine.bind
        self._cycle, self._receive = bind("cycle", memory), bind("receive", memory)

    def step(
        self,
        encoders: Any,
        packet: bytes | Packet | Sequence[bytes | Packet] | None = None,
        pins: int | Sequence[int] = 0,
        read_ok: bool | Sequence[bool] = True,
    ) -> Output:
        """Run one 1 ms cycle.

        `encoders`: [arms, 7] counts as unpacked from USB, integers; an int32 array is the fastest.
        `packet`: packets since the last cycle, as 124-byte ITP datagrams (shorter ones are dropped,
        as in the robot) or `Packet`s. `pins`: input byte of each board, or one byte for all boards;
        bits 7 and 6 are the PLC's run level. `read_ok`: whether the USB read of each board
        succeeded. After a failed read, the software uses the board's previous encoders and pins.
        Raises UserError, which names the wrong argument; the state is then unchanged.
        """
        row, arms = self._row, len(self.setup.arms)
        counts = checked.parse_counts("encoders", encoders, (arms, 7))
        pin_bytes = checked.per_board("pins", pins, 255, (arms,))
        flags = checked.per_board("read_ok", read_ok, 1, (arms,))
        *earlier, last = self._parse_packets(packet)
        # All arguments are checked, so from here on the state may change.
        row.enc_val[0], row.pins[0], row.read_ok[0] = counts, pin_bytes, flags
        self._receive_all(earlier)
        row.enter(last)
        self._cycle()
        written = self._written
        dac = tuple(tuple(x.item() for x in arm.current_cmd_written) for arm in written.arms)
        kind, content = self.code.kinds["signals"], self._out.tobytes()
        return Output(dac, written.pins_out.item(), kind, content)

    def run(
        self, encoders: Any, packets: Any = None, pins: Any = 0, read_ok: Any = True
    ) -> Outputs:
        """Run many 1 ms cycles in one call, with the results of `step` but faster.

        `encoders`: [cycles, arms, 7] counts. `packets`: a list with one entry per cycle, each as
        for `step`; None: no packets. `pins` and `read_ok`: one value for all cycles, or an array
        [cycles] or [cycles, arms]. Returns `dac` [cycles, arms, 7], `output_pins` [cycles] and
        `signals`, whose leaves are arrays [cycles]. Results take half a kilobyte per cycle and arm.
        Raises UserError, which names the wrong argument; the state is then unchanged.
        """
        arms = len(self.setup.arms)
        counts = checked.parse_counts("encoders", encoders, (None, arms, 7))
        cycles = len(counts)
        rows = InputRows(self.setup, cycles)
        rows.enc_val[...] = counts
        rows.pins[...] = checked.per_board("pins", pins, 255, (cycles,), (cycles, arms))
        rows.read_ok[...] = checked.per_board("read_ok", read_ok, 1, (cycles,), (cycles, arms))
        packets = checked.require_list(
            "packets",
            (None,) * cycles if packets is None else packets,
            cycles,
            f"a list with one entry per cycle ({cycles}): a datagram, a Packet, a list or None",
        )
        earlier_packets: dict[int, list[Datagram | Packet | None]] = {}
        for cycle, packet in enumerate(packets):
            *earlier, last = self._parse_packets(packet)
            rows.enter(last, cycle)
            if earlier:
                earlier_packets[cycle] = earlier
        out = aligned_buffer(cycles, self.code.kinds["signals"].layout.bytes)
        # One call computes all cycles up to the next cycle in which several packets arrive.
        begin = 0
        for end in (*earlier_packets, cycles):
            memory = Memory(self._fixed, self._state, rows.bytes[begin:end], out[begin:end])
            self.code.machine.bind("cycle", memory)()
            self._receive_all(earlier_packets.get(end, ()))
            begin = end
        signals: control.ControlSignals = self.code.kinds["signals"].columns(out)
        dac = [np.stack(arm.current_cmd_written, axis=-1) for arm in signals.arms]
        return Outputs(np.stack(dac, axis=1), signals.pins_out, signals)

    def __copy__(self) -> ControlSoftware:
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other._take_memory(self.state)
        return other

    def __deepcopy__(self, memo: Any) -> ControlSoftware:
        return self.__copy__()

    @property
    def state(self) -> control.ControlState:
        """The whole state, with the histories of checks. Another instance may start from it."""
        return self.code.kinds["state"].read(self._state)

    def _receive_all(self, packets: Sequence[Datagram | Packet | None]) -> None:
        """Process packets that arrive before the last packet of a cycle."""
        for packet in packets:
            self._row.enter(packet)
            self._receive()

    def _parse_packets(self, given: Any) -> list[Datagram | Packet | None]:
        # Returns the packets of a cycle, at least one entry; None: no packet.
        packets = given if isinstance(given, list | tuple) else [given]
        return [self._parse_packet(packet) for packet in packets] or [None]

    def _parse_packet(self, given: bytes | Packet | None) -> Datagram | Packet | None:
        # Returns a datagram unchanged, and a `Packet` with checked numbers.
        if given is None:
            return None
        if isinstance(given, Packet):
            return checked.parse_packet(self.setup, given)
        if not isinstance(given, Datagram):
            kind = type(given).__name__
            raise UserError(
                f"packet is {kind}, expected a datagram (bytes), a Packet, a list of these, or None"
            )
        if self.setup.console != "increments":
            raise UserError(
                "packet is a datagram (bytes), which contains increments. With console 'absolute',"
                " expected an object of class Packet, which contains positions"
            )
        return given


def _change_params(params: control.ControlParams, change: Any) -> control.ControlParams:
    """Return `change(params)`, with each number converted to the type of its parameter."""
    if not callable(change):
        raise UserError(
            f"params is {format_value(change)}, expected a function that gets the ControlParams"
            " and returns changed ControlParams"
        )
    new = change(params)
    if not isinstance(new, control.ControlParams):
        raise UserError(
            f"params returned {format_value(new)}, expected the ControlParams that the function"
            " gets, with changed numbers"
        )
    return checked.record_like("params", new, params, finite=True)


def _encoders_at(
    setup: RavenSetup, params: control.ControlParams, jpos: Sequence[Sequence[float]]
) -> list[list[int]]:
    """Return the counts [arms, 7] nearest to joints [arms, 7], rad and m."""
    counts = []
    for arm, tool, estimator, joints in zip(
        setup.arms, setup.tools, params.estimator, jpos, strict=True
    ):
        motors = transmission.motor_from_joint(arm, tool, Vec(joints), software=setup.software)
        signs = transmission.encoder_signs(arm, tool, setup.software)
        # A count is sign (motor angle in counts + offset): the inverse of `stages.estimator.step`.
        counts.append(
            [
                round(float(sign) * (float(motor) / float(RAD_PER_COUNT) + int(offset)))
                for motor, sign, offset in zip(motors, signs, estimator.enc_offset, strict=True)
            ]
        )
    return counts


def _at_measured_pose(
    state: control.ControlState, after: control.ControlState, signals: control.ControlSignals
) -> control.ControlState:
    """Return `state` with the arms at rest in the pose that one cycle in E-stop measured.
    after, signals: state and signals of that cycle.
    """
    poses = tuple(arm.pos for arm in after.cartesian)
    joints, motors = control.columns_of(signals.arms, "jpos", "mpos").values()
    # The pose that the console has commanded starts from the measured pose.
    accumulated = control.replace_fields(after.teleoperation.arms, pose=poses)
    return replace(
        state,
        usb=after.usb,
        cartesian=control.replace_fields(state.cartesian, pos=poses, pos_d=poses, jpos_d=joints),
        teleoperation=replace(state.teleoperation, arms=accumulated),
        motor_control=control.replace_fields(state.motor_control, mpos_d=motors),
    )
