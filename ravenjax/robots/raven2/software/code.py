"""Compiles a cycle of the control software for each set of options, and defines its results."""

import dataclasses
import functools

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.transition import Compiled, Interpreted, RecordKind, StateTransition
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software.rows import row_kind

ARITHMETICS = ("compiled", "interpreted")


@dataclasses.dataclass(frozen=True)
class Output:
    """The output of one cycle."""

    dac: tuple[tuple[int, ...], ...]  # per arm 7 signed counts, as written to USB
    output_pins: int  # byte to the PLC: run level (bits 0, 1), FP (2), READY (3), watchdog (4)
    _kind: RecordKind = dataclasses.field(repr=False, compare=False)
    _row: bytes = dataclasses.field(repr=False, compare=False)

    @functools.cached_property
    def signals(self) -> control.ControlSignals:
        """All signals at the seams of the control software in this cycle."""
        return self._kind.read(self._row)


@dataclasses.dataclass(frozen=True, eq=False)
class Outputs:
    """The outputs of several cycles."""

    dac: np.ndarray  # [cycles, arms, 7] int32, signed counts, as written to USB
    output_pins: np.ndarray  # [cycles] int32, bytes to the PLC
    signals: control.ControlSignals  # at the seams of the software, each number an array [cycles]


@dataclasses.dataclass(frozen=True)
class TransitionCode:
    """The programs of one set of options, with the types of their records."""

    transitions: dict[str, StateTransition]  # by name, see `software_code`
    kinds: dict[str, RecordKind]  # of params, state and signals
    arithmetic: str = "compiled"  # one of ARITHMETICS

    @functools.cached_property
    def machine(self) -> Compiled | Interpreted:
        """The transitions, ready to run on this computer."""
        # The cache of compiled code is shared with campaigns.
        from ravenjax.campaign import compile_cache

        if self.arithmetic == "interpreted":
            return Interpreted(self.transitions)
        text = transition.print_module(self.transitions)
        return Compiled(text, self.transitions, compile_cache.object_cache())


@functools.lru_cache(maxsize=16)
def software_code(
    setup: RavenSetup, params: RecordKind, state: RecordKind, arithmetic: str
) -> TransitionCode:
    """Return the programs of a setup. params, state: types of the parameters and of the state.

    Program "cycle" computes one millisecond with its last packet. If several packets arrive in a
    millisecond, program "receive" first processes each of the earlier packets. Functions such as
    the sine are those of the C library.
    """
    inputs_kind = row_kind(setup)
    shapes = params.shapes(), state.shapes(), inputs_kind.shapes()

    def receive(params, state, inputs: control.Inputs):
        return control.receive_packet(setup, params, state, inputs.packet)

    run_cycle = functools.partial(control.control_cycle, setup)
    with traced.x64_context(setup):
        cycle, (_, signals) = traced.trace_function(run_cycle, *shapes, functions="library")
        reception, _ = traced.trace_function(receive, *shapes, functions="library")
    layouts = params.layout, state.layout, inputs_kind.layout
    transitions = {
        "cycle": StateTransition(cycle, *layouts),
        "receive": StateTransition(reception, *layouts),
    }
    kinds = {"params": params, "state": state, "signals": RecordKind.of(signals)}
    return TransitionCode(transitions, kinds, arithmetic)
