"""The control software as transitions: traced and made ready once a setup, shared by all who run
it; and what it wrote.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu.transition import (
    Compiled,
    Interpreted,
    RecordKind,
    StateTransition,
    TransitionMachine,
    print_module,
)
from ravenjax.engines.trace_key import Objects
from ravenjax.numbers import tree
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software.rows import row_kind

ARITHMETICS = ("compiled", "interpreted")


@dataclasses.dataclass(frozen=True)
class Output:
    """What one cycle wrote."""

    dac: tuple[tuple[int, ...], ...]  # per arm 7 signed counts, as written to USB
    output_pins: int  # byte to the PLC: run level (bits 0, 1), FP (2), READY (3), watchdog (4)
    _kind: RecordKind = dataclasses.field(repr=False, compare=False)
    _row: bytes = dataclasses.field(repr=False, compare=False)

    @functools.cached_property
    def signals(self) -> control.ControlSignals:
        """Everything that crossed the seams of the control software in this cycle."""
        return self._kind.read(self._row)


@dataclasses.dataclass(frozen=True, eq=False)
class Outputs:
    """What each of some cycles wrote."""

    dac: np.ndarray  # [cycles, arms, 7] int32, signed counts, as written to USB
    output_pins: np.ndarray  # [cycles] int32, bytes to the PLC
    _kind: RecordKind = dataclasses.field(repr=False)
    _rows: np.ndarray = dataclasses.field(repr=False)

    @functools.cached_property
    def signals(self) -> control.ControlSignals:
        """Everything that crossed the seams of the control software, each number an array
        [cycles].
        """
        return self._kind.columns(self._rows)


@dataclasses.dataclass(frozen=True)
class SoftwareCode:
    """The software of one setup, ready to run: transition "cycle" is one millisecond, "receive"
    takes one packet that arrives before the last of a cycle."""

    machine: TransitionMachine
    transitions: dict[str, StateTransition]  # what it is made of
    kinds: dict[str, RecordKind]  # of "params", "state", and "signals", which leave a cycle

    @functools.cached_property
    def _places(self) -> tuple[list[int], int]:
        """Where the commands of each arm and the output pins stand in what leaves."""
        kind = self.kinds["signals"]
        offsets = tree.filled(kind.record, list(kind.layout.offsets))
        return [arm.current_cmd_written[0] for arm in offsets.arms], offsets.pins_out

    def output(self, row: np.ndarray) -> Output:
        """What a single cycle wrote, whose signals are in this row."""
        dac, pins = self._places
        content = row.tobytes()
        commands = [tuple(np.frombuffer(content, np.int32, 7, start).tolist()) for start in dac]
        written = int.from_bytes(content[pins : pins + 4], "little")
        return Output(tuple(commands), written, self.kinds["signals"], content)

    def outputs(self, rows: np.ndarray) -> Outputs:
        """What some cycles wrote, [cycles, bytes]."""
        dac, pins = self._places
        words = rows.view(np.int32)
        commands = np.stack([words[:, start // 4 : start // 4 + 7] for start in dac], axis=1)
        return Outputs(commands, words[:, pins // 4].copy(), self.kinds["signals"], rows)


def objects() -> Objects | None:
    """Where compiled code outlives the process."""
    # No campaign, but the folder where any compiled code is kept.
    from ravenjax.campaign import compile_cache

    return compile_cache.objects()


@functools.lru_cache(maxsize=16)
def code(setup: RavenSetup, params: RecordKind, state: RecordKind, arithmetic: str) -> SoftwareCode:
    """The code of a setup whose parameters and state are of these kinds."""
    entering = row_kind(setup)
    shapes = params.shapes(), state.shapes(), entering.shapes()

    def run_cycle(params: Any, state: Any, inputs: control.Inputs) -> Any:
        return control.cycle(setup, params, state, inputs)

    def receive(params: Any, state: Any, inputs: control.Inputs) -> Any:
        return control.receive(setup, params, state, inputs.packet)

    with traced.x64(setup):
        cycle, (_, signals) = traced.trace_function(run_cycle, *shapes, functions="library")
        reception, _ = traced.trace_function(receive, *shapes, functions="library")
    transitions = {
        name: StateTransition(program, params.layout, state.layout, entering.layout)
        for name, program in (("cycle", cycle), ("receive", reception))
    }
    machine: TransitionMachine
    if arithmetic == "interpreted":
        machine = Interpreted(transitions)
    else:
        machine = Compiled(print_module(transitions), transitions, objects())
    kinds = {"params": params, "state": state, "signals": RecordKind.of(signals)}
    return SoftwareCode(machine, transitions, kinds)
