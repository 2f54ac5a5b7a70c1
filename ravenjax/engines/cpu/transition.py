"""Runs a program that computes the next state of one robot and its outputs, step by step.

The program is a function (fixed, state, step_inputs, tables) -> (state, step_outputs). `fixed` does
not change, and `tables` has 1-D arrays. All but `tables` are records of scalars, stored as rows of
bytes. Inputs and outputs have one row per step. No operations are fused. `Compiled` runs machine
code, and `Interpreted` runs each operation in NumPy (`ir.semantics`). Both give the same bits.
"""

import ctypes
import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines import traced
from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.kernel import schedule_operations
from ravenjax.engines.cpu.llvm import BRANCH_WEIGHTS, LlvmPrinter, repeat_lines
from ravenjax.engines.cpu.memory import BufferLayout, aligned_buffer
from ravenjax.ir import semantics
from ravenjax.ir.program import Program
from ravenjax.ir.regions import arrange_regions
from ravenjax.numbers import tree

EMPTY = BufferLayout.aligned([])
STEPS = (
    "ptr noalias %fixed, ptr noalias %state, ptr noalias %step_inputs0, i64 %step_inputs_bytes, ptr"
    " noalias %step_outputs0, i64 %step_outputs_bytes, ptr noalias %tables, i64 %count"
)
"""Parameters of a transition's function. They are: fixed numbers, state, rows of inputs and outputs
with their strides, tables, steps.
"""
# Pointer -> bytes by which it advances per step.
_POINTER_STEPS = {"step_inputs": "%step_inputs_bytes", "step_outputs": "%step_outputs_bytes"}


@dataclasses.dataclass(frozen=True)
class RecordKind:
    """The types of a record of single numbers, and their locations in a row of bytes."""

    record: Any  # the record with each leaf replaced by its dtype
    layout: BufferLayout

    @staticmethod
    def of(example: Any) -> "RecordKind":
        """Return the kind of records like `example`, a record of NumPy or Python numbers."""
        record = tree.map_leaves(
            lambda x: x.dtype if hasattr(x, "dtype") else np.asarray(x).dtype, example
        )
        return RecordKind(record, BufferLayout.aligned(map(str, tree.tree_leaves(record))))

    def shapes(self) -> Any:
        """Return the record of JAX's shapes, for tracing."""
        return traced.record_shapes(self.record)

    def row(self, value: Any) -> np.ndarray:
        """Return a record's numbers as a row of bytes."""
        row = aligned_buffer(1, self.layout.bytes)[0]
        write_row(self.layout, row, tree.tree_leaves(value))
        return row

    def read(self, row: np.ndarray | bytes) -> Any:
        """Return the record of the numbers in a row."""
        return self._filler(read_row(self.layout, row))

    @functools.cached_property
    def _filler(self) -> Callable[[Sequence[Any]], Any]:
        return tree.tree_filler(self.record)

    def views(self, row: np.ndarray) -> Any:
        """Return a record of views of a row, arrays of one number each."""
        return tree.fill_tree(self.record, [x for (x,) in self.layout.views(row[np.newaxis])])

    def columns(self, rows: np.ndarray) -> Any:
        """Return a record of arrays [rows], each with the same number of all rows of bytes."""
        pairs = zip(self.layout.views(rows), self.layout.types, strict=True)
        columns = [(x != 0 if kind == "bool" else x)[:, 0] for x, kind in pairs]
        return tree.fill_tree(self.record, columns)


def read_row(layout: BufferLayout, row: np.ndarray | bytes) -> list[Any]:
    """Return the numbers of a row as Python numbers, except for float32."""
    if not layout.types:
        return []
    (numbers,) = np.frombuffer(row, layout.dtype).tolist()
    # `tolist` gives Python numbers: a float32 as a float, which computes in float64, a bool as int.
    types: dict[str, Any] = {"float32": np.float32, "bool": bool}
    pairs = zip(layout.types, numbers, strict=True)
    return [types[dtype](x) if dtype in types else x for dtype, x in pairs]


def write_row(layout: BufferLayout, row: np.ndarray, numbers: Sequence[Any]) -> None:
    """Write numbers to a row, if there are any."""
    if numbers:
        row[: layout.bytes].view(layout.dtype)[0] = tuple(numbers)


@dataclasses.dataclass(frozen=True)
class StateTransition:
    """One transition function and the layouts of its numbers."""

    # Computes `state` and `step_outputs` from the numbers of `fixed`, `state` and `step_inputs`.
    program: Program
    fixed: BufferLayout
    state: BufferLayout
    step_inputs: BufferLayout

    @property
    def step_outputs(self) -> BufferLayout:
        """Layout of the outputs: the results after the new state."""
        outputs = self.program.outputs[len(self.state.types) :]
        return BufferLayout.aligned(self.program.operations[i].dtype for i in outputs)


class Memory(NamedTuple):
    """The arrays of bytes that a transition reads and writes, and its concatenated tables. The
    state is overwritten in each step. There is one row of inputs and outputs per step.
    """

    fixed: np.ndarray  # [bytes]
    state: np.ndarray  # [bytes]
    step_inputs: np.ndarray  # [steps, bytes]
    step_outputs: np.ndarray  # [steps, bytes]
    tables: np.ndarray | None = None


class Interpreted:
    """Runs transitions one operation at a time in Python."""

    def __init__(self, transitions: Mapping[str, StateTransition]):
        self._transitions = transitions

    def bind(self, name: str, memory: Memory) -> Callable[[], None]:
        """Return a function as `Compiled.bind` does, for a program that reads no tables."""
        transition = self._transitions[name]

        def make_transition():
            fixed = read_row(transition.fixed, memory.fixed)
            for inputs, outputs in zip(memory.step_inputs, memory.step_outputs, strict=True):
                state = read_row(transition.state, memory.state)
                step_inputs = read_row(transition.step_inputs, inputs)
                after = semantics.run_program(transition.program, [*fixed, *state, *step_inputs])
                write_row(transition.state, memory.state, after[: len(state)])
                write_row(transition.step_outputs, outputs, after[len(state) :])

        return make_transition


class Compiled:
    """Runs transitions as machine code, all in one module."""

    def __init__(self, text: str, names: Iterable[str], objects: jit.Objects | None = None):
        """text: from `print_module`. objects: cache of compiled code."""
        names = list(names)
        self._module = jit.compile_functions(text, names, objects)
        pointer, size = ctypes.c_void_p, ctypes.c_int64
        # The types of STEPS. Keys: name, and whether calls are brief (see `HostModule.function`).
        types = [pointer, pointer, pointer, size, pointer, size, pointer, size]
        keys = itertools.product(names, (False, True))
        self._functions = {key: self._module.function(key[0], types, key[1]) for key in keys}

    def bind(self, name: str, memory: Memory) -> "BoundTransition":
        """Return a function that makes the transition `name` once for each row of `memory`."""
        return BoundTransition(self._functions[name, len(memory.step_inputs) == 1], memory, self)


class BoundTransition:
    """A transition with its memory. A call makes the transition once for each row."""

    def __init__(self, function: Any, memory: Memory, machine: Compiled):
        fixed, state, step_inputs, step_outputs, tables = memory
        # ctypes keeps addresses only, not the arrays and the code behind them.
        self._alive = memory, machine
        self._function, self._steps = function, len(step_inputs)
        # `write_outputs_to` changes this pointer, which is one of the arguments.
        self._output_pointer = ctypes.c_void_p(step_outputs.ctypes.data)
        # The parameters of STEPS. ctypes converts its own number types faster than Python's.
        pointer, size = ctypes.c_void_p, ctypes.c_int64
        self._arguments = (
            pointer(fixed.ctypes.data),
            pointer(state.ctypes.data),
            pointer(step_inputs.ctypes.data),
            size(step_inputs.strides[0]),  # bytes from the inputs of a step to those of the next
            self._output_pointer,
            size(step_outputs.strides[0]),
            pointer(None if tables is None else tables.ctypes.data),
            size(self._steps),
        )

    def __call__(self) -> None:
        if self._steps:
            self._function(*self._arguments)

    def write_outputs_to(self, address: int) -> None:
        """Set the address for the outputs of later calls."""
        self._output_pointer.value = address


def print_module(
    transitions: Mapping[str, StateTransition], features: Set[str] | None = None
) -> str:
    """Return LLVM IR with one function per transition; one call applies it to rows of step inputs.
    features: names of the CPU's features; None: those of this machine.
    """
    features = jit.host_target().features if features is None else features
    texts, declared = [], set[str]()
    for name, transition in transitions.items():
        printer = _print_transition(transition, features)
        texts.append(repeat_lines(name, STEPS, printer, _POINTER_STEPS))
        declared |= printer.declared
    return "\n".join([*texts, *sorted(declared), BRANCH_WEIGHTS])


def _print_transition(transition: StateTransition, features: Set[str]) -> LlvmPrinter:
    # Prints one step of a transition of one robot, the body of the loop over steps.
    program = transition.program
    state = transition.state.places("%state")
    step_inputs = transition.step_inputs.places("%step_inputs")
    # Places in memory of the program's inputs, in order. `reads`: operation -> index of the input.
    inputs = [*transition.fixed.places("%fixed"), *state, *step_inputs]
    sources = {i: inputs[k] for i, k in program.reads.items()}
    targets = [*state, *transition.step_outputs.places("%step_outputs")]
    results = list(zip(program.outputs, targets, strict=True))
    order = [i for i in program.needed() if program.operations[i].name not in ("input", "constant")]
    printer = LlvmPrinter(width=1, features=frozenset(features), in_loop=True)
    # First, operations that are seldom needed are joined to regions, which a step can skip. Then
    # operations are reordered, between regions and within each, so that the CPU waits less.
    arranged = arrange_regions(program.operations, order, program.outputs)
    scheduled = schedule_operations(program.operations, arranged)
    printer.run(program, scheduled, sources, results)
    return printer
