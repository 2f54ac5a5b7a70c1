"""A state that moves a step at a time by functions of single numbers: (fixed, state, entering) ->
(state, leaving).

All numbers stand in memory, one row of bytes for each of the four; what enters and what leaves may
be many rows, one a step. Every operation is one IEEE operation, nothing is fused, and functions are
those of the C library. `Compiled` and `Interpreted` have the same bits: the second is `python`'s
printed code, to check the first by.
"""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, NamedTuple, Protocol

import numpy as np
from jax.extend import core

from ravenjax.engines.cpu import jit, python
from ravenjax.engines.cpu.llvm import BRANCH_WEIGHTS, LlvmPrinter, repeated
from ravenjax.engines.cpu.memory import RowLayout
from ravenjax.ir.lowering import lower
from ravenjax.ir.regions import arrange

_CALL = ("fixed", "state", "entering0", "entering_bytes", "leaving0", "leaving_bytes", "count")
"""What a call's block of 64-bit numbers holds: one argument instead of seven, which Python would
convert each time.
"""


@dataclasses.dataclass(frozen=True)
class StateTransition:
    """One function and where its numbers stand."""

    jaxpr: core.ClosedJaxpr  # of the numbers of `fixed`, `state` and `entering`, in this order
    fixed: RowLayout
    state: RowLayout
    entering: RowLayout

    @property
    def leaving(self) -> RowLayout:
        """What leaves: the results behind the new state."""
        avals: Any = self.jaxpr.out_avals
        return RowLayout.packed(str(aval.dtype) for aval in avals[len(self.state.types) :])


class Memory(NamedTuple):
    """What transitions work on, bytes each: what is fixed, the state, which they overwrite, and
    rows in and out.
    """

    fixed: np.ndarray  # [bytes]
    state: np.ndarray  # [bytes]
    entering: np.ndarray  # [steps, bytes]
    leaving: np.ndarray  # [steps, bytes]


class TransitionMachine(Protocol):
    """Runs transitions."""

    def bind(self, name: str, memory: Memory) -> Callable[[], None]:
        """A function that takes the transition `name` once for each row of `memory`."""
        ...


def rows(layout: RowLayout, steps: int) -> np.ndarray:
    """Zeroed bytes [steps, bytes], on a cache line."""
    raw = np.zeros(steps * layout.bytes + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + steps * layout.bytes].reshape(steps, layout.bytes)


def read(layout: RowLayout, row: np.ndarray | bytes) -> list[Any]:
    """Numbers of a row, as `python` represents them."""
    if not layout.types:
        return []
    (numbers,) = np.frombuffer(row, layout.dtype).tolist()
    return [_OF_TYPE.get(dtype, _same)(x) for dtype, x in zip(layout.types, numbers, strict=True)]


def write(layout: RowLayout, row: np.ndarray, numbers: Sequence[Any]) -> None:
    """Put numbers in a row, if there are any."""
    if numbers:
        row[: layout.bytes].view(layout.dtype)[0] = tuple(numbers)


def _same(x: Any) -> Any:
    return x


_OF_TYPE: Mapping[str, Callable[[Any], Any]] = {"float32": np.float32, "bool": bool}


class Interpreted:
    """Transitions as printed Python."""

    def __init__(self, transitions: Mapping[str, StateTransition]) -> None:
        self._functions = {
            name: (one, python.compile(one.jaxpr)) for name, one in transitions.items()
        }

    def bind(self, name: str, memory: Memory) -> Callable[[], None]:
        """See `TransitionMachine`."""
        one, function = self._functions[name]
        states, leaving = len(one.state.types), one.leaving
        fixed = read(one.fixed, memory.fixed)

        def run() -> None:
            for inputs, outputs in zip(memory.entering, memory.leaving, strict=True):
                after = function(
                    [*fixed, *read(one.state, memory.state), *read(one.entering, inputs)]
                )
                write(one.state, memory.state, after[:states])
                write(leaving, outputs, after[states:])

        return run


class Compiled:
    """Transitions as machine code, all in one module."""

    def __init__(
        self, transitions: Mapping[str, StateTransition], objects: jit.Objects | None = None
    ) -> None:
        """objects: where compiled code is kept."""
        text = "\n".join(
            [module_text(transitions, jit.host().features), *map(_called, transitions)]
        )
        self._module = module = jit.compile(text, list(transitions), objects)
        self._functions = {
            (name, brief): module.function(name, [ctypes.c_void_p], brief)
            for name in transitions
            for brief in (False, True)
        }

    def bind(self, name: str, memory: Memory) -> Callable[[], None]:
        """See `TransitionMachine`."""
        fixed, state, entering, leaving = memory
        inside = entering.ctypes.data, entering.strides[0], leaving.ctypes.data, leaving.strides[0]
        block = np.array(
            [fixed.ctypes.data, state.ctypes.data, *inside, len(entering)], np.uintp
        )  # as _CALL names it
        function, address = self._functions[name, len(entering) == 1], block.ctypes.data

        def run(_alive: Any = (block, memory, self)) -> None:
            function(address)

        return run if len(entering) else _nothing


def module_text(transitions: Mapping[str, StateTransition], features: Set[str]) -> str:
    """LLVM IR of a function NAME_steps for each transition, for a CPU with these features; see
    `STEPS`.
    """
    texts, declared = [], set[str]()
    for name, transition in transitions.items():
        printer = _printed(transition, features)
        texts.append(repeated(f"{name}_steps", STEPS, printer, _MOVES))
        declared |= printer.declared
    return "\n".join([*texts, *sorted(declared), BRANCH_WEIGHTS])


def _nothing() -> None:
    """No rows, no steps."""


STEPS = (
    "ptr noalias %fixed, ptr noalias %state, ptr noalias %entering0, i64 %entering_bytes, ptr"
    " noalias %leaving0, i64 %leaving_bytes"
)
"""Parameters of NAME_steps before `i64 %count`: what is fixed, the state, rows in and out and
bytes between two.
"""
_MOVES = {"entering": "%entering_bytes", "leaving": "%leaving_bytes"}


def _printed(transition: StateTransition, features: Set[str]) -> LlvmPrinter:
    """The lines of one step."""
    program = lower(transition.jaxpr, functions="library")
    if program.tables:
        raise TypeError("a transition reads no tables")
    sources_of = [
        *transition.fixed.places("%fixed"),
        *transition.state.places("%state"),
        *transition.entering.places("%entering"),
    ]
    sources = {
        i: sources_of[op.detail] for i, op in enumerate(program.operations) if op.name == "input"
    }
    targets = [*transition.state.places("%state"), *transition.leaving.places("%leaving")]
    results = list(zip(program.outputs, targets, strict=True))
    order = [i for i in program.needed() if program.operations[i].name not in ("input", "constant")]
    printer = LlvmPrinter(1, frozenset(features), "again")
    printer.run(program, arrange(program.operations, order, program.outputs), sources, results)
    return printer


def _called(name: str) -> str:
    """The function that Python calls: takes its arguments from a block."""
    loads = "".join(
        f"  %at{k} = getelementptr i64, ptr %block, i64 {k}\n  %{what} = load {_kind(what)}, ptr"
        f" %at{k}\n"
        for k, what in enumerate(_CALL)
    )
    arguments = ", ".join(f"{_kind(what)} %{what}" for what in _CALL)
    return (
        f"define void @{name}(ptr %block) {{\n{loads}  call void @{name}_steps({arguments})\n  ret"
        " void\n}\n"
    )


def _kind(what: str) -> str:
    return "i64" if what.endswith("bytes") or what == "count" else "ptr"
