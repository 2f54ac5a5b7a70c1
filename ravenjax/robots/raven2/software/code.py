"""The control software as a transition: traced and made ready once a setup, shared by all who run it."""

from __future__ import annotations

import dataclasses
import functools
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.memory import RowLayout
from ravenjax.engines.cpu.transition import Compiled, Interpreted, StateTransition, TransitionMachine
from ravenjax.numbers.lazy import jax
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.packet import silence
from ravenjax.robots.raven2.loop import control
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.software.rows import row_layout
from ravenjax.robots.raven2.stages.usb import UsbIn

ARITHMETICS = ("compiled", "interpreted")


class RecordKind:
    """The shape of a record of NumPy numbers: its tree, its number types and where they stand in memory."""

    def __init__(self, example: Any) -> None:
        leaves: list[Any]
        leaves, tree = jax.tree.flatten(example)
        self.tree: Any = tree
        self.types = tuple(str(np.dtype(leaf.dtype)) for leaf in leaves)
        self.layout = RowLayout.packed(self.types)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RecordKind) and (self.tree, self.types) == (other.tree, other.types)

    def __hash__(self) -> int:
        return hash((self.tree, self.types))

    def abstract(self) -> Any:
        """The record as tracing takes it."""
        return jax.tree.unflatten(self.tree, [jax.ShapeDtypeStruct((), dtype) for dtype in self.types])

    def row(self, value: Any) -> np.ndarray:
        """A record's numbers in memory."""
        row = transition.rows(self.layout, 1)[0]
        transition.write(self.layout, row, jax.tree.leaves(value))
        return row

    def read(self, row: np.ndarray | bytes) -> Any:
        """The record of numbers in memory."""
        return jax.tree.unflatten(self.tree, transition.read(self.layout, row))


@dataclasses.dataclass(frozen=True)
class SoftwareCode:
    """The software of one setup, ready to run: transition "cycle" is one millisecond, "receive" takes one packet that
    arrives before the last of a cycle."""

    machine: TransitionMachine
    signals: RecordKind  # what leaves a cycle


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

    from ravenjax.campaign import compile_cache  # no campaign, but the folder where any compiled code is kept

    with widths(setup):
        cycle, (_, signals) = jax.make_jaxpr(one_cycle, return_shape=True)(*kinds)
        reception = jax.make_jaxpr(receive)(*kinds)
        transitions = {
            name: StateTransition(jaxpr, params.layout, state.layout, entering)
            for name, jaxpr in (("cycle", cycle), ("receive", reception))
        }
        interpreted = arithmetic == "interpreted"
        machine = Interpreted(transitions) if interpreted else Compiled(transitions, compile_cache.objects())
    return SoftwareCode(machine, RecordKind(signals))


def example_inputs(setup: RavenSetup) -> control.Inputs:
    """Inputs of the right types."""
    flags = (np.int32(1),) * len(setup.arms)
    return control.Inputs(silence(setup), UsbIn(tuple(Vec.full(7, np.int32(0)) for _ in flags), flags), flags)


def widths(setup: RavenSetup) -> AbstractContextManager[Any]:
    """JAX with 64-bit numbers where the setup has any, and without where not."""
    return jax.enable_x64(setup.precision.needs_x64)
