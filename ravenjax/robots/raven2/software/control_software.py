"""The control software driven alone: encoders, packets and PLC pins in, DAC commands and output
pins out.

    software = ControlSoftware(tools=("r_grasper", "r_grasper"))
    output = software.step(encoders, packet=datagram, pins=0b11 << 6)
    output.dac[0], output.output_pins, output.signals.runlevel

Put your own plant or hardware behind it. It is the tick's own control software, evaluated in the
original's mixed arithmetic (float32 stored, float64 in between), in the original's order
(`original.evaluation`): every number equals the original's. It runs compiled, or one operation at a
time in Python, with the same bits (`engines.cpu.transition`).
"""

# Callers may pass anything, and JAX is typed in part.
# pyright: reportUnnecessaryIsInstance=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# pyright: reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.record_kind import RecordKind
from ravenjax.engines.cpu.transition import Memory
from ravenjax.errors import UserError, shown
from ravenjax.numbers import paths
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.setup import ORIGINAL, Precision
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.packet import SIZE_BYTES, Packet
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software import inputs as given_inputs
from ravenjax.robots.raven2.software import series, start
from ravenjax.robots.raven2.software.code import ARITHMETICS, SoftwareCode, code, widths
from ravenjax.robots.raven2.software.output import Output, OutputReader, Outputs
from ravenjax.robots.raven2.software.rows import InputRows
from ravenjax.robots.raven2.stages import overdrive

Datagram = bytes | bytearray | memoryview


class ControlSoftware:
    """Raven-II control software, one `step` a millisecond.

    It starts as if homing had just completed, in cartesian mode: raven2 in run level 0, waiting for
    the PLC; the 2015 fork in pedal-down, for its simulator builds have no PLC. Arms are in
    mechanism order, gold first; joints in the order shoulder, elbow, insertion, tool_roll, wrist,
    grasp1, grasp2.

    It starts at the home pose, or where `jpos`, `encoders` or `state` say; then the first
    pedal-down asks for what is there. Give one of them for a robot that stands elsewhere: its jaws
    would jump to the opening of the home pose, as the original takes over a measured opening only
    where it is more than 45 deg off.
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
        """`tools`: one per arm, the software's own if left out. `level`: an overdrive level
        ("beginner", "moderate", "advanced", "fork2015"). `enc_offset`: encoder counts at motor
        angle 0, a number, [7] or [arms, 7]. `runlevel`: the one to start in, 0 to 3. `params`:
        changes any other parameter. `precision`: other widths than the original's.

        One of these says where it starts: `jpos`, joints [arms, 7] in rad and m, taken to the
        nearest encoder counts; `encoders`, counts [arms, 7] as `step` takes them; `state`, the
        `state` of another one, which it continues to the bit. `arithmetic`: "interpreted" gives the
        same bits, 100 times slower. Raises UserError."""
        given_inputs.known("software", software, DEFAULT_TOOLS)
        given_inputs.known("policy", policy, overdrive.POLICIES)
        given_inputs.known("console", console, SIZE_BYTES)
        given_inputs.known("arithmetic", arithmetic, ARITHMETICS)
        if level is not None:
            given_inputs.known("level", level, overdrive.LEVELS)
        if runlevel is not None:
            runlevel = given_inputs.whole("runlevel", runlevel, 0, 3)
        if not isinstance(precision, Precision):
            raise UserError(f"precision is {shown(precision)}, expected a ravenjax.Precision")
        way = start.one_of(jpos=jpos, encoders=encoders, state=state)
        if way == "state" and runlevel is not None:
            raise UserError(
                f"runlevel is {runlevel}, but a state has its own run level; leave one of them out"
            )
        names = given_inputs.arm_names(arms)
        own = tuple(DEFAULT_TOOLS[software][arm] for arm in names)
        chosen_tools = own if tools is None else given_inputs.tool_names(tools, names)
        self.setup = RavenSetup(
            arms=names, software=software, tools=chosen_tools, console=console, precision=precision
        )
        offsets = given_inputs.counts("enc_offset", enc_offset, len(names), repeated=True)
        with widths(self.setup):
            parameters = _parameters(self.setup, level, policy, offsets)
            parameters = parameters if params is None else _changed(self.setup, parameters, params)
            initial = control.init(self.setup, runlevel=runlevel)
        if way == "jpos":
            encoders = start.encoders_at(
                self.setup, parameters, given_inputs.joints("jpos", jpos, len(names))
            )
        if way in ("jpos", "encoders"):
            encoders = given_inputs.counts(str(way), encoders, len(names))
        self._kind, params_kind = RecordKind(initial), RecordKind(parameters)
        if way == "state":
            initial = start.saved(self._kind, state)
        self._code = code(self.setup, params_kind, self._kind, arithmetic)
        self._fixed = params_kind.row(parameters)
        if way in ("jpos", "encoders"):
            initial = start.at_encoders(
                self.setup, self._code, self._kind, self._fixed, initial, encoders
            )
        self._memory(initial)

    def _memory(self, initial: control.ControlState) -> None:
        """Take memory for the state and for one cycle's rows."""
        self._state, self._row = self._kind.row(initial), InputRows(self.setup)
        self._shape, self._enc_val = self._row.enc_val.shape[1:], self._row.enc_val[0]
        self._pins, self._read_ok = self._row.pins[0], self._row.read_ok[0]
        self._out = transition.rows(self._code.signals.layout, 1)
        memory = Memory(self._fixed, self._state, self._row.bytes, self._out)
        self._cycle, self._receive = (
            self._code.machine.bind(name, memory) for name in ("cycle", "receive")
        )
        self._reader = OutputReader(self._code.signals)
        self._increments = self.setup.console == "increments"

    def step(
        self,
        encoders: Any,
        packet: bytes | Packet | Sequence[bytes | Packet] | None = None,
        pins: int | Sequence[int] = 0,
        read_ok: bool | Sequence[bool] = True,
    ) -> Output:
        """One 1 ms cycle.

        `encoders`: [arms, 7] counts as unpacked from USB, integers; an int32 array is the quickest.
        `packet`: what arrived since the last cycle, 124-byte ITP datagrams (shorter ones are
        dropped, as the robot does) or `Packet`s. `pins`: input byte of each board (one number: of
        all), bits 7..6 the PLC's run level. `read_ok`: whether each board's read succeeded; where
        not, its last encoders and pins are used again. UserError names the argument that is wrong;
        nothing has happened then.
        """
        if (
            type(encoders) is np.ndarray
            and encoders.dtype == np.int32
            and encoders.shape == self._shape
        ):
            self._enc_val[...] = encoders
        else:
            self._enc_val[...] = given_inputs.counts("encoders", encoders, len(self.setup.arms))
        if type(pins) is int and 0 <= pins <= 255:
            self._pins.fill(pins)
        else:
            self._pins[...] = given_inputs.pins(pins, len(self.setup.arms))
        if read_ok is True:
            self._read_ok.fill(1)
        else:
            self._read_ok[...] = given_inputs.flags("read_ok", read_ok, len(self.setup.arms))
        if packet is None:
            self._row.silence()
        elif type(packet) is bytes and self._increments:
            self._row.datagram(packet)
        else:
            *earlier, last = self._packets(packet)
            for one in earlier:
                self._enter(self._row, 0, one)
                self._receive()
            self._enter(self._row, 0, last)
        self._cycle()
        return self._reader.one(self._out.tobytes())

    def run(
        self, encoders: Any, packets: Any = None, pins: Any = 0, read_ok: Any = True
    ) -> Outputs:
        """Many 1 ms cycles in one call: the same as a `step` for each, and quicker.

        `encoders`: [cycles, arms, 7] counts. `packets`: a list with one entry a cycle, each as
        `step` takes it; None: no packets. `pins` and `read_ok`: one of all, [cycles] or [cycles,
        arms]. Returns `dac` [cycles, arms, 7], `output_pins` [cycles] and `signals`, whose numbers
        are arrays [cycles]: half a kilobyte a cycle and arm. UserError names the argument that is
        wrong; nothing has happened then.
        """
        arms = len(self.setup.arms)
        counts = series.counts("encoders", encoders, arms)
        cycles = len(counts)
        rows = InputRows(self.setup, cycles)
        rows.enc_val[...] = counts
        rows.pins[...] = series.numbers("pins", pins, (cycles, arms), 0, 255)
        rows.read_ok[...] = series.numbers("read_ok", read_ok, (cycles, arms), 0, 1)
        earlier = self._fill(rows, series.packets(packets, cycles))
        out = transition.rows(self._code.signals.layout, cycles)
        begin = 0
        for cycle in (*earlier, cycles):
            part = Memory(self._fixed, self._state, rows.bytes[begin:cycle], out[begin:cycle])
            self._code.machine.bind("cycle", part)()
            for one in earlier.get(cycle, ()):
                self._enter(self._row, 0, one)
                self._receive()
            begin = cycle
        return self._reader.many(out)

    def __copy__(self) -> ControlSoftware:
        """Another one in the same state, which goes its own way."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other._memory(self.state)
        return other

    def __deepcopy__(self, memo: Any) -> ControlSoftware:
        return self.__copy__()

    @property
    def state(self) -> control.ControlState:
        """Everything the software remembers, the checks' histories among it; another one may
        start with it.
        """
        return self._kind.read(self._state)

    @property
    def params(self) -> control.ControlParams:
        """What is set in it."""
        return self.code.kinds["params"].read(self._fixed)

    @property
    def code(self) -> SoftwareCode:
        """What it is made of, for those who print it anew."""
        return self._code

    def _fill(
        self, rows: InputRows, packets: Sequence[Any]
    ) -> dict[int, list[Datagram | Packet | None]]:
        """Put the last packet of each cycle in its row; those before it, by cycle."""
        earlier: dict[int, list[Datagram | Packet | None]] = {}
        for cycle, packet in enumerate(packets):
            *before, last = self._packets(packet)
            self._enter(rows, cycle, last)
            if before:
                earlier[cycle] = before
        return earlier

    @staticmethod
    def _enter(rows: InputRows, cycle: int, packet: Datagram | Packet | None) -> None:
        if packet is None:
            rows.silence(cycle)
        elif isinstance(packet, Packet):
            rows.packet(packet, cycle)
        else:
            rows.datagram(packet, cycle)

    def _packets(self, given: Any) -> list[Datagram | Packet | None]:
        many: list[Any] = list(given) if isinstance(given, list | tuple) else [given]
        return [self._packet(one) for one in many] or [None]

    def _packet(self, given: bytes | Packet | None) -> Datagram | Packet | None:
        if given is None:
            return None
        if isinstance(given, Packet):
            return given_inputs.packet(self.setup, given)
        if not isinstance(given, Datagram):
            kind = type(given).__name__
            raise UserError(
                f"packet is {kind}; give the bytes of a datagram, a Packet, a list of them, or None"
            )
        if not self._increments:
            raise UserError(
                "a raw datagram holds increments, but console is 'absolute'; give a Packet"
            )
        return given


def _parameters(
    setup: RavenSetup, level: str | None, policy: str, offsets: Sequence[Any]
) -> control.ControlParams:
    """The software's own, but for what has an argument of its own."""
    own = control.params(setup)
    return replace(
        own,
        overdrive=overdrive.params(setup, level, overdrive.POLICIES.index(policy)),
        estimator=tuple(
            replace(e, enc_offset=Vec(map(np.int32, o)))
            for e, o in zip(own.estimator, offsets, strict=True)
        ),
    )


def _changed(setup: RavenSetup, own: control.ControlParams, change: Any) -> control.ControlParams:
    """The parameters as `change` returns them, each number in its own type."""
    if not callable(change):
        raise UserError(
            f"params is {shown(change)}, expected a function that takes the ControlParams and"
            " returns changed ones"
        )
    new = change(own)
    kinds, numbers = (list(paths.leaves(record, setup)) for record in (own, new))
    if not isinstance(new, control.ControlParams) or [name for name, _ in kinds] != [
        name for name, _ in numbers
    ]:
        raise UserError(
            f"params returned {shown(new)}, expected the ControlParams it was given, with numbers"
            " replaced"
        )
    return jax.tree.unflatten(
        jax.tree.structure(own),
        [_of_type(name, old, x) for (name, old), (_, x) in zip(kinds, numbers, strict=True)],
    )


def _of_type(name: str, old: Any, new: Any) -> Any:
    if old.dtype.kind == "i":
        return old.dtype.type(given_inputs.whole(f"parameter {name}", new, *given_inputs.INT32))
    number = isinstance(new, int | float | np.number) and not isinstance(new, bool)
    if not number or not abs(new) <= float(np.finfo(old.dtype).max):
        raise UserError(f"parameter {name} is {shown(new)}, expected a finite number")
    return old.dtype.type(new)
