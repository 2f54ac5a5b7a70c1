"""Runs one compiled robot whose caller advances it tick by tick, for example in a training session.

The robot runs the operations of engine `simd` for one lane and gives the same bits. State, inputs
and tables are plain memory. Between two ticks the caller may change inputs, for example to start a
fault. The caller may also run a copy of the state, and write the operator's motion row by row.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.engines import trace_key, traced
from ravenjax.engines.cpu import jit, transition
from ravenjax.engines.cpu.memory import BufferLayout, aligned_buffer, stored_size
from ravenjax.engines.cpu.transition import EMPTY, Compiled, Memory, RecordKind, StateTransition
from ravenjax.numbers import lazy, tree
from ravenjax.numbers.lazy import jax


class StepCode:
    """A traced and compiled loop, shared by its `Stepper`s."""

    def __init__(
        self,
        begin: Callable[[Any], Any],
        step: Callable[[Any, Any, Any, Any, Any], tuple[Any, Sequence[Any]]],
        finish: Callable[[Any, Any], dict[str, Any]],
        inputs: Any,
        step_inputs: Any,
        tables: Sequence[int],
        objects: jit.Objects | None = None,
        key: str = "",
    ):
        """Trace and compile three functions.

        begin(inputs) -> state; step(inputs, state, tick, step_inputs, tables) -> (state, float32
        outputs of the tick); finish(inputs, state) -> named numbers. inputs, step_inputs: examples
        of the records, numbers of 32 bits. tables: lengths of float32 tables. objects: cache of
        compiled code. key: hash of all inputs of the functions, without source files; "": nothing
        is cached. Raises TypeError if a tick returns anything but float32.
        """
        self.inputs = RecordKind.of(inputs)
        self.step_inputs = RecordKind.of((np.int32(0), step_inputs))
        self.tables = tuple(tables)

        def make():
            # Traces the three functions and prints them as one module. Returns its text, the kinds
            # of the state and of the outcomes, and the number of a tick's outputs.
            def step_with_row(inputs, state, row, tables):
                tick, step_inputs = row
                return step(inputs, state, tick, step_inputs, tables)

            begin_program, state = traced.trace_function(begin, self.inputs.shapes())
            columns = tuple(jax.ShapeDtypeStruct((n,), np.float32) for n in self.tables)
            step_program, (_, outputs) = traced.trace_function(
                step_with_row, self.inputs.shapes(), state, self.step_inputs.shapes(), columns
            )
            finish_program, outcomes = traced.trace_function(finish, self.inputs.shapes(), state)
            dtypes = [x.dtype for x in tree.tree_leaves(outputs)]
            if any(dtype != np.float32 for dtype in dtypes):
                raise TypeError("every output of a tick must be float32")
            state_kind = RecordKind.of(state)
            fixed, row = self.inputs.layout, self.step_inputs.layout
            # Layouts of a transition: inputs that stay fixed, the state that the program replaces,
            # and inputs of a step. `finish` replaces no state, so it reads the state as an input.
            transitions = {
                "begin": StateTransition(begin_program, fixed, EMPTY, EMPTY),
                "step": StateTransition(step_program, fixed, state_kind.layout, row),
                "finish": StateTransition(finish_program, fixed, EMPTY, state_kind.layout),
            }
            text = transition.print_module(transitions)
            return text, state_kind, RecordKind.of(outcomes), len(dtypes)

        # The generated code depends on the CPU's instructions.
        types = [str(kind.layout) + repr(kind.record) for kind in (self.inputs, self.step_inputs)]
        parts = key, types, self.tables, jit.host_target().text
        key = key and trace_key.persistent_key("step", *parts)
        text, self.state, self.outcomes, self.outputs = trace_key.load_or_make(objects, key, make)
        self.machine = Compiled(text, ("begin", "step", "finish"), objects)


class Stepper:
    """One robot that runs a `StepCode`. The caller writes to the arrays `inputs`, `step_inputs` and
    `tables`. `inputs[k][0] = x` changes input k, and `step_inputs[k][0] = x` input k of the next
    tick. Steppers may share tables.
    """

    def __init__(self, code: StepCode, inputs: Any, tables: np.ndarray | None = None):
        """inputs: see `StepCode`. tables: float32, all columns concatenated; zeros if omitted."""
        self.code = code
        # Bytes in memory. The arrays `inputs`, `_tick` and `step_inputs` are views of them.
        fixed = code.inputs.row(inputs)
        step_inputs = aligned_buffer(1, code.step_inputs.layout.bytes)
        self.inputs: list[np.ndarray] = tree.tree_leaves(code.inputs.views(fixed))
        self._tick: np.ndarray
        self._tick, *self.step_inputs = tree.tree_leaves(code.step_inputs.views(step_inputs[0]))
        # np.full instead of np.zeros: the memory is then allocated before the first tick.
        self.flat = np.full(sum(code.tables), 0.0, np.float32) if tables is None else tables
        self.tables = np.split(self.flat, np.cumsum(code.tables)[:-1]) if code.tables else []
        self._state = aligned_buffer(1, code.state.layout.bytes)
        self._results = aligned_buffer(1, code.outcomes.layout.bytes)
        nothing = aligned_buffer(1, 0)
        bind = code.machine.bind
        self._begin = bind("begin", Memory(fixed, nothing, nothing, self._state))
        out = aligned_buffer(1, BufferLayout.aligned(["float32"] * code.outputs).bytes)
        self._step = bind("step", Memory(fixed, self._state, step_inputs, out, self.flat))
        self._finish = bind("finish", Memory(fixed, nothing, self._state, self._results))
        self.begin()

    def begin(self) -> None:
        """Return to the state before the first tick."""
        self._begin()

    def step(self, tick: int, out: int) -> None:
        """Run one tick, and write its float32 outputs to address `out`."""
        self._tick[0] = tick
        self._step.write_outputs_to(out)
        self._step()

    def outcomes(self) -> dict[str, Any]:
        """Return the outcomes so far."""
        self._finish()
        return self.code.outcomes.read(self._results[0])

    def snapshot(self) -> np.ndarray:
        """Return a copy of the state, which any stepper of the same code can `restore`."""
        return self._state[0].copy()

    def restore(self, snapshot: np.ndarray) -> None:
        """Set the state from a snapshot."""
        self._state[0] = snapshot

    def change(self, function: Callable[[Any], Any]) -> None:
        """Replace the state by `function(state)`, with the state as a record of numbers."""
        kind = self.code.state
        with lazy.run_eagerly():
            self._state[0] = kind.row(function(kind.read(self._state[0])))

    def restore_leaves(self, snapshot: np.ndarray, leaves: Sequence[int]) -> None:
        """Set some numbers of the state from a snapshot, by their indices in the state's record."""
        layout = self.code.state.layout
        for k in leaves:
            number = slice(layout.offsets[k], layout.offsets[k] + stored_size(layout.types[k]))
            self._state[0, number] = snapshot[number]
