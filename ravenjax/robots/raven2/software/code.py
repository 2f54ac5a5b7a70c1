"""The control software as a transition: traced and made ready once a setup, shared by all who
run it.
"""

from __future__ import annotations

import dataclasses
import functools
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from ravenjax.engines.cpu.jit import Objects
from ravenjax.engines.cpu.record_kind import RecordKind
from ravenjax.engines.cpu.transition import (
    Compiled,
    Interpreted,
    StateTransition,
    TransitionMachine,
)
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.packet import silence
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software.rows import row_layout
from ravenjax.robots.raven2.stages.usb import UsbIn

ARITHMETICS = ("compiled", "interpreted")


@dataclasses.dataclass(frozen=True)
class SoftwareCode:
    """The software of one setup, ready to run: transition "cycle" is one millisecond, "receive"
    takes one packet that arrives before the last of a cycle."""

    machine: TransitionMachine
    transitions: dict[str, StateTransition]  # what it is made of
    kinds: dict[str, RecordKind]  # of "params", "state", and "signals", which leave a cycle

    @property
    def signals(self) -> RecordKind:
        """What leaves a cycle."""
        return self.kinds["signals"]


@functools.lru_cache(maxsize=16)
def code(setup: RavenSetup, params: RecordKind, state: RecordKind, arithmetic: str) -> SoftwareCode:
    """The code of a setup whose parameters and state are of these kinds."""
    example = example_inputs(setup)
    entering = row_layout(setup, example)
    kinds = params.abstract(), state.abstract(), RecordKind(example).abstract()

    def one_cycle(params: Any, state: Any, inputs: control.Inputs) -> Any:
        return control.cycle(setup, params, state, inputs)

    def receive(params: Any, state: Any, inputs: control.Inputs) -> Any:
        return control.receive(setup, params, state, inputs.packet)

    with widths(setup):
        cycle, (_, signals) = jax.make_jaxpr(one_cycle, return_shape=True)(*kinds)
        reception = jax.make_jaxpr(receive)(*kinds)
        transitions = {
            name: StateTransition(jaxpr, params.layout, state.layout, entering)
            for name, jaxpr in (("cycle", cycle), ("receive", reception))
        }
        interpreted = arithmetic == "interpreted"
        machine = Interpreted(transitions) if interpreted else Compiled(transitions, objects())
    kinds = {"params": params, "state": state, "signals": RecordKind(signals)}
    return SoftwareCode(machine, transitions, kinds)


def example_inputs(setup: RavenSetup) -> control.Inputs:
    """Inputs of the right types."""
    flags = (np.int32(1),) * len(setup.arms)
    return control.Inputs(
        silence(setup), UsbIn(tuple(Vec.full(7, np.int32(0)) for _ in flags), flags), flags
    )


def objects() -> Objects | None:
    """Where compiled code outlives the process."""
    from ravenjax.campaign import (
        compile_cache,
    )  # no campaign, but the folder where any compiled code is kept

    return compile_cache.objects()


def widths(setup: RavenSetup) -> AbstractContextManager[Any]:
    """JAX with 64-bit numbers where the setup has any, and without where not."""
    return jax.enable_x64(setup.precision.needs_x64)
