"""The control software driven alone: encoders, packets and PLC pins in, DAC commands and output pins out.

    software = ControlSoftware(tools=("r_grasper", "r_grasper"))
    output = software.step(encoders, packet=datagram, pins=0b11 << 6)
    output.dac[0], output.output_pins, output.signals.runlevel

Put your own plant or hardware behind it. It is the tick's own control software, evaluated in the original's mixed
arithmetic (float32 stored, float64 in between), in the original's order (`ravenjax.robot.evaluation`), one operation at
a time (`ravenjax.engines.scalar`): every number equals the original's.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, Literal

import jax
import numpy as np

from ravenjax import control
from ravenjax.engines import scalar
from ravenjax.errors import UserError, suggestion
from ravenjax.robot.packet import SIZE_BYTES, Packet, decode
from ravenjax.robot.tools import DEFAULT_TOOLS
from ravenjax.stages import overdrive
from ravenjax.stages.usb import UsbIn
from ravenjax.types import JOINTS, ORIGINAL, ArmName, Precision, Setup, Vec, replace

POLICIES = ("none", "soft", "hard")
"""Overdrive policies by number."""


@dataclasses.dataclass(frozen=True)
class Output:
    """What one cycle wrote."""

    dac: tuple[tuple[int, ...], ...]  # per arm 7 signed counts, as written to USB
    output_pins: int  # byte to the PLC: run level (bits 0, 1), FP (2), READY (3), watchdog (4)
    _signals: Callable[[], control.Signals] = dataclasses.field(repr=False)

    @functools.cached_property
    def signals(self) -> control.Signals:
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
        policy: Literal["none", "soft", "hard"] = "soft",
        level: str | None = None,
        enc_offset: Any = 0,
        console: Literal["increments", "absolute"] = "increments",
        runlevel: int | None = None,
        params: Callable[[control.Params], control.Params] | None = None,
        precision: Precision = ORIGINAL,
    ) -> None:
        """`tools`: one per arm, the software's own if left out. `level`: an overdrive level ("beginner", "moderate",
        "advanced", "fork2015"). `enc_offset`: encoder counts at motor angle 0, a number or [arms, 7]. `runlevel`: the
        one to start in. `params`: changes any other parameter. `precision`: other widths than the original's."""
        _known("software", software, DEFAULT_TOOLS)
        _known("policy", policy, POLICIES)
        for arm in arms:
            _known("arm", arm, DEFAULT_TOOLS[software])
        names = tuple(tools) if tools is not None else tuple(DEFAULT_TOOLS[software][arm] for arm in arms)
        self.setup = Setup(arms=tuple(arms), software=software, tools=names, console=console, precision=precision)
        offsets = _integers("enc_offset", np.broadcast_to(enc_offset, (len(names), 7)), (len(names), 7))
        with _widths(self.setup):
            chosen = control.params(self.setup)
            chosen = replace(
                chosen,
                overdrive=overdrive.params(self.setup, level, POLICIES.index(policy)),
                estimator=tuple(replace(e, enc_offset=o) for e, o in zip(chosen.estimator, offsets, strict=True)),
            )
            chosen = params(chosen) if params is not None else chosen
            state = control.init(self.setup, runlevel=runlevel)
        self._params, self._states, self._inputs = _Kind(chosen), _Kind(state), _Kind(_example_inputs(self.setup))
        self._fixed, self._now = self._params.represent(chosen), self._states.represent(state)
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

        `encoders`: [arms, 7] counts as unpacked from USB. `packet`: what arrived since the last cycle, 124-byte ITP
        datagrams or `Packet`s. `pins`: input byte of each board (one number: of all), bits 7..6 the PLC's run level.
        `read_ok`: whether each board's read succeeded; where not, its last encoders and pins are used again.
        """
        arms = len(self.setup.arms)
        counts = _integers("encoders", encoders, (arms, 7))
        *earlier, last = self._packets(packet)
        for one in earlier:
            self._receive(one)
        usb = UsbIn(counts, _each("pins", pins, arms))
        inputs = control.Inputs(last, usb, _each("read_ok", read_ok, arms))
        out = self._cycle([*self._fixed, *self._now, *self._inputs.represent(inputs)])
        signals = out[len(self._now) :]
        self._now = out[: len(self._now)]
        return Output(
            tuple(tuple(signals[i] for i in places) for places in self._dac_places),
            signals[self._pins_place],
            lambda: jax.tree.unflatten(self._signals, signals),
        )

    @property
    def state(self) -> control.State:
        """Everything the software remembers, the checks' histories among it."""
        return jax.tree.unflatten(self._states.tree, self._now)

    def _receive(self, packet: Packet) -> None:
        packets = _Kind(packet)
        receive = _reception(self.setup, self._params, self._states, packets)
        self._now = receive([*self._fixed, *self._now, *packets.represent(packet)])

    def _packets(self, given: Any) -> list[Packet]:
        many = list(given) if isinstance(given, (list, tuple)) else [given]
        return [self._packet(one) for one in many] or [self._packet(None)]

    def _packet(self, given: bytes | Packet | None) -> Packet:
        if given is None:
            return _silence(self.setup)
        if isinstance(given, Packet):
            return _typed(self.setup, given)
        if not isinstance(given, (bytes, bytearray, memoryview)):
            kind = type(given).__name__
            raise UserError(f"packet is {kind}; give the bytes of a datagram, a Packet, a list of them, or None")
        if self.setup.console == "absolute":
            raise UserError("a raw datagram holds increments, but console is 'absolute'; give a Packet")
        return _typed(self.setup, decode(bytes(given), self.setup.arms))


class _Kind:
    """The shape of a record of NumPy numbers: its tree and number types."""

    def __init__(self, example: Any) -> None:
        leaves, self.tree = jax.tree.flatten(example)
        self.types = tuple(np.dtype(leaf.dtype) for leaf in leaves)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Kind) and (self.tree, self.types) == (other.tree, other.types)

    def __hash__(self) -> int:
        return hash((self.tree, self.types))

    def abstract(self) -> Any:
        return jax.tree.unflatten(self.tree, [jax.ShapeDtypeStruct((), dtype) for dtype in self.types])

    def represent(self, value: Any) -> list[Any]:
        return [scalar.represent(dtype, x) for dtype, x in zip(self.types, jax.tree.leaves(value), strict=True)]


@functools.lru_cache(maxsize=16)
def _cycle(setup: Setup, params: _Kind, state: _Kind, inputs: _Kind) -> tuple[Any, scalar.ScalarFunction]:
    """Tree of the signals, and the cycle as printed code: shared by the instances of a setup."""

    def one_cycle(*arguments: Any) -> Any:
        return control.cycle(setup, *arguments)

    with _widths(setup):
        kinds = (params.abstract(), state.abstract(), inputs.abstract())
        jaxpr, shape = jax.make_jaxpr(one_cycle, return_shape=True)(*kinds)
    return jax.tree.structure(shape[1]), scalar.compile(jaxpr)


@functools.lru_cache(maxsize=16)
def _reception(setup: Setup, params: _Kind, state: _Kind, packet: _Kind) -> scalar.ScalarFunction:
    """`receive` alone as printed code, for packets that arrive before the last of a cycle."""

    def receive(*arguments: Any) -> Any:
        return control.receive(setup, *arguments)

    with _widths(setup):
        return scalar.compile(jax.make_jaxpr(receive)(params.abstract(), state.abstract(), packet.abstract()))


@functools.lru_cache(maxsize=16)
def _silence(setup: Setup) -> Packet:
    """No packet in this cycle."""
    arms, zero = range(len(setup.arms)), np.int32(0)
    number = np.dtype(setup.precision.wide).type
    return Packet(
        received=zero,
        size=np.int32(SIZE_BYTES[setup.console]),
        sequence=zero,
        delta=tuple(Vec.full(3, zero) for _ in arms),
        quat=tuple(Vec(map(number, (0.0, 0.0, 0.0, 1.0))) for _ in arms),
        grasp=tuple(zero for _ in arms),
        surgeon_mode=zero,
    )


def _typed(setup: Setup, packet: Packet) -> Packet:
    """The packet with the number types of a cycle's input."""
    kinds, tree = jax.tree.flatten(_silence(setup))
    numbers = jax.tree.leaves(packet)
    if len(numbers) != len(kinds):
        arms = len(setup.arms)
        raise UserError(
            f"packet holds {len(numbers)} numbers, expected {len(kinds)} for arms {setup.arms}; give its tuples delta "
            f"(3 each), quat (4 each) and grasp one entry per arm ({arms})"
        )
    return jax.tree.unflatten(tree, [kind.dtype.type(x) for kind, x in zip(kinds, numbers, strict=True)])


def _example_inputs(setup: Setup) -> control.Inputs:
    flags = (np.int32(1),) * len(setup.arms)
    return control.Inputs(_silence(setup), UsbIn(tuple(Vec.full(7, np.int32(0)) for _ in flags), flags), flags)


def _widths(setup: Setup) -> AbstractContextManager[Any]:
    return jax.enable_x64(setup.precision.needs_x64)


def _known(what: str, word: str, known: Any) -> None:
    if word not in known:
        raise UserError(f"{what} is {word!r}, expected one of {', '.join(known)}{suggestion(word, known)}")


def _integers(what: str, given: Any, shape: tuple[int, int]) -> tuple[Vec, ...]:
    array = np.asarray(given)
    if array.shape != shape or array.dtype.kind not in "iu":
        raise UserError(
            f"{what} has shape {array.shape} of {array.dtype}, expected integers [arms, 7] = {list(shape)}; give one "
            f"row of counts per arm in the order {', '.join(JOINTS)}"
        )
    return tuple(Vec(np.int32(x) for x in row) for row in array.tolist())


def _each(what: str, given: Any, arms: int) -> tuple[Any, ...]:
    values = tuple(given) if isinstance(given, (list, tuple, np.ndarray)) else (given,) * arms
    if len(values) != arms:
        raise UserError(f"{what} has {len(values)} entries, expected one number or one per arm ({arms})")
    return tuple(int(value) for value in values)
