"""The control software driven alone: encoders, packets and PLC pins in, DAC commands and output pins out.

    software = ControlSoftware(tools=("r_grasper", "r_grasper"))
    output = software.step(encoders, packet=datagram, pins=0b11 << 6)
    output.dac[0], output.output_pins, output.signals.runlevel

Put your own plant or hardware behind it. It is the tick's own control software, evaluated in the original's mixed
arithmetic (float32 stored, float64 in between), in the original's order (`original.evaluation`), one operation at
a time (`ravenjax.engines.cpu.python`): every number equals the original's.
"""

# Callers may pass anything, and JAX is typed in part.
# pyright: reportUnnecessaryIsInstance=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# pyright: reportUnknownVariableType=false

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, Literal

import jax
import numpy as np

from ravenjax.engines.cpu import python
from ravenjax.errors import UserError, shown
from ravenjax.numbers import paths
from ravenjax.numbers.setup import ORIGINAL, Precision
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.packet import SIZE_BYTES, Packet, decode, silence
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software import inputs as given_inputs
from ravenjax.robots.raven2.stages import overdrive
from ravenjax.robots.raven2.stages.usb import UsbIn


@dataclasses.dataclass(frozen=True)
class Output:
    """What one cycle wrote."""

    dac: tuple[tuple[int, ...], ...]  # per arm 7 signed counts, as written to USB
    output_pins: int  # byte to the PLC: run level (bits 0, 1), FP (2), READY (3), watchdog (4)
    _signals: Callable[[], control.ControlSignals] = dataclasses.field(repr=False)

    @functools.cached_property
    def signals(self) -> control.ControlSignals:
        """Everything that crossed the seams of the control software in this cycle."""
        return self._signals()


class ControlSoftware:
    """Raven-II control software, one `step` a millisecond.

    It starts as if homing had just completed, in cartesian mode: raven2 in run level 0, waiting for the PLC; the 2015
    fork in pedal-down, for its simulator builds have no PLC. Arms are in mechanism order, gold first; joints in the
    order shoulder, elbow, insertion, tool_roll, wrist, grasp1, grasp2.
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
    ) -> None:
        """`tools`: one per arm, the software's own if left out. `level`: an overdrive level ("beginner", "moderate",
        "advanced", "fork2015"). `enc_offset`: encoder counts at motor angle 0, a number, [7] or [arms, 7]. `runlevel`:
        the one to start in, 0 to 3. `params`: changes any other parameter. `precision`: other widths than the
        original's. Raises UserError."""
        given_inputs.known("software", software, DEFAULT_TOOLS)
        given_inputs.known("policy", policy, overdrive.POLICIES)
        given_inputs.known("console", console, SIZE_BYTES)
        if level is not None:
            given_inputs.known("level", level, overdrive.LEVELS)
        if runlevel is not None:
            runlevel = given_inputs.whole("runlevel", runlevel, 0, 3)
        if not isinstance(precision, Precision):
            raise UserError(f"precision is {shown(precision)}, expected a ravenjax.Precision")
        names = given_inputs.arm_names(arms)
        own = tuple(DEFAULT_TOOLS[software][arm] for arm in names)
        chosen_tools = own if tools is None else given_inputs.tool_names(tools, names)
        self.setup = RavenSetup(arms=names, software=software, tools=chosen_tools, console=console, precision=precision)
        offsets = given_inputs.counts("enc_offset", enc_offset, len(names), repeated=True)
        with _widths(self.setup):
            parameters = control.params(self.setup)
            parameters = replace(
                parameters,
                overdrive=overdrive.params(self.setup, level, overdrive.POLICIES.index(policy)),
                estimator=tuple(
                    replace(e, enc_offset=Vec(map(np.int32, o)))
                    for e, o in zip(parameters.estimator, offsets, strict=True)
                ),
            )
            parameters = parameters if params is None else _changed(self.setup, parameters, params)
            state = control.init(self.setup, runlevel=runlevel)
        self._params, self._states, self._inputs = _Kind(parameters), _Kind(state), _Kind(_example_inputs(self.setup))
        self._packets_kind = _Kind(silence(self.setup))
        self._fixed, self._now = self._params.represent(parameters), self._states.represent(state)
        self._signals, self._cycle = _cycle(self.setup, self._params, self._states, self._inputs)
        places = jax.tree.unflatten(self._signals, range(self._signals.num_leaves))
        self._dac_places = [list(arm.current_cmd_written) for arm in places.arms]
        self._pins_place = places.pins_out

    def step(
        self,
        encoders: Any,
        packet: bytes | Packet | Sequence[bytes | Packet] | None = None,
        pins: int | Sequence[int] = 0,
        read_ok: bool | Sequence[bool] = True,
    ) -> Output:
        """One 1 ms cycle.

        `encoders`: [arms, 7] counts as unpacked from USB, integers. `packet`: what arrived since the last cycle,
        124-byte ITP datagrams (shorter ones are dropped, as the robot does) or `Packet`s. `pins`: input byte of each
        board (one number: of all), bits 7..6 the PLC's run level. `read_ok`: whether each board's read succeeded;
        where not, its last encoders and pins are used again. UserError names the argument that is wrong; nothing has
        happened then.
        """
        arms = len(self.setup.arms)
        counts = tuple(Vec(row) for row in given_inputs.counts("encoders", encoders, arms))
        bytes_in = tuple(given_inputs.whole("pins", byte, 0, 255) for byte in given_inputs.each("pins", pins, arms))
        read = tuple(given_inputs.flag("read_ok", ok) for ok in given_inputs.each("read_ok", read_ok, arms))
        *earlier, last = self._packets(packet)
        for one in earlier:
            self._receive(one)
        inputs = control.Inputs(last, UsbIn(counts, bytes_in), read)
        out = self._cycle([*self._fixed, *self._now, *self._inputs.represent(inputs)])
        signals = out[len(self._now) :]
        self._now = out[: len(self._now)]
        return Output(
            tuple(tuple(signals[i] for i in places) for places in self._dac_places),
            signals[self._pins_place],
            lambda: jax.tree.unflatten(self._signals, signals),
        )

    @property
    def state(self) -> control.ControlState:
        """Everything the software remembers, the checks' histories among it."""
        return jax.tree.unflatten(self._states.tree, self._now)

    def _receive(self, packet: Packet) -> None:
        receive = _reception(self.setup, self._params, self._states, self._packets_kind)
        self._now = receive([*self._fixed, *self._now, *self._packets_kind.represent(packet)])

    def _packets(self, given: Any) -> list[Packet]:
        many: list[Any] = list(given) if isinstance(given, (list, tuple)) else [given]
        return [self._packet(one) for one in many] or [self._packet(None)]

    def _packet(self, given: bytes | Packet | None) -> Packet:
        if given is None:
            return silence(self.setup)
        if isinstance(given, Packet):
            return given_inputs.packet(self.setup, given)
        if not isinstance(given, (bytes, bytearray, memoryview)):
            kind = type(given).__name__
            raise UserError(f"packet is {kind}; give the bytes of a datagram, a Packet, a list of them, or None")
        if self.setup.console == "absolute":
            raise UserError("a raw datagram holds increments, but console is 'absolute'; give a Packet")
        return decode(bytes(given), self.setup.arms)


class _Kind:
    """The shape of a record of NumPy numbers: its tree and number types."""

    def __init__(self, example: Any) -> None:
        leaves: list[Any]
        leaves, tree = jax.tree.flatten(example)
        self.tree: Any = tree
        self.types = tuple(np.dtype(leaf.dtype) for leaf in leaves)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Kind) and (self.tree, self.types) == (other.tree, other.types)

    def __hash__(self) -> int:
        return hash((self.tree, self.types))

    def abstract(self) -> Any:
        return jax.tree.unflatten(self.tree, [jax.ShapeDtypeStruct((), dtype) for dtype in self.types])

    def represent(self, value: Any) -> list[Any]:
        return [python.represent(dtype, x) for dtype, x in zip(self.types, jax.tree.leaves(value), strict=True)]


@functools.lru_cache(maxsize=16)
def _cycle(setup: RavenSetup, params: _Kind, state: _Kind, inputs: _Kind) -> tuple[Any, python.ScalarFunction]:
    """Tree of the signals, and the cycle as printed code: shared by the instances of a setup."""

    def one_cycle(*arguments: Any) -> Any:
        return control.cycle(setup, *arguments)

    with _widths(setup):
        kinds = (params.abstract(), state.abstract(), inputs.abstract())
        jaxpr, shape = jax.make_jaxpr(one_cycle, return_shape=True)(*kinds)
    return jax.tree.structure(shape[1]), python.compile(jaxpr)


@functools.lru_cache(maxsize=16)
def _reception(setup: RavenSetup, params: _Kind, state: _Kind, packet: _Kind) -> python.ScalarFunction:
    """`receive` alone as printed code, for packets that arrive before the last of a cycle."""

    def receive(*arguments: Any) -> Any:
        return control.receive(setup, *arguments)

    with _widths(setup):
        return python.compile(jax.make_jaxpr(receive)(params.abstract(), state.abstract(), packet.abstract()))


def _changed(setup: RavenSetup, own: control.ControlParams, change: Any) -> control.ControlParams:
    """The parameters as `change` returns them, each number in its own type."""
    if not callable(change):
        raise UserError(
            f"params is {shown(change)}, expected a function that takes the ControlParams and returns changed ones"
        )
    new = change(own)
    kinds, numbers = (list(paths.leaves(record, setup)) for record in (own, new))
    if not isinstance(new, control.ControlParams) or [name for name, _ in kinds] != [name for name, _ in numbers]:
        raise UserError(f"params returned {shown(new)}, expected the ControlParams it was given, with numbers replaced")
    return jax.tree.unflatten(
        jax.tree.structure(own), [_of_type(name, old, x) for (name, old), (_, x) in zip(kinds, numbers, strict=True)]
    )


def _of_type(name: str, old: Any, new: Any) -> Any:
    if old.dtype.kind == "i":
        return old.dtype.type(given_inputs.whole(f"parameter {name}", new, *given_inputs.INT32))
    number = isinstance(new, int | float | np.number) and not isinstance(new, bool)
    if not number or not abs(new) <= float(np.finfo(old.dtype).max):
        raise UserError(f"parameter {name} is {shown(new)}, expected a finite number")
    return old.dtype.type(new)


def _example_inputs(setup: RavenSetup) -> control.Inputs:
    flags = (np.int32(1),) * len(setup.arms)
    return control.Inputs(silence(setup), UsbIn(tuple(Vec.full(7, np.int32(0)) for _ in flags), flags), flags)


def _widths(setup: RavenSetup) -> AbstractContextManager[Any]:
    return jax.enable_x64(setup.precision.needs_x64)
