"""Generates the functions that run a time loop on the CPU, as one LLVM module.

Lanes are robots that run side by side. Lanes whose robots have the same parameters form a group.
Numbers that are equal in a group are computed once. The functions are:

    shared_begin  computes the first state of a group from the group's inputs
    shared_run    advances a group by some ticks and writes one row of numbers per tick
    lane_begin    computes the first state and the constant numbers of `width` lanes
    lane_run      advances the same lanes by the same ticks and reads the rows of their group
    lane_finish   writes the results of the lanes

`make_calls` makes a list of calls of these functions. This file also defines the layout of their
buffers. For each number, a buffer of lanes has `width` values, and a buffer of groups one value.
"""

import bisect
import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path

from ravenjax import resources
from ravenjax.engines.cpu.llvm import BRANCH_WEIGHTS, TEXTS, LlvmPrinter, repeat_lines
from ravenjax.engines.cpu.memory import BufferLayout, Place
from ravenjax.engines.printing import LoopPrinting
from ravenjax.ir.program import Operation
from ravenjax.ir.regions import Region
from ravenjax.ir.time_loop import Split

WINDOW = 200
"""Number of operations, from the earliest unscheduled, among which the next is chosen."""
LATENCIES: dict[str, int] = TEXTS["latencies"]
"""Cycles until an operation's result is available; for operations that are not listed, 2."""


def schedule_operations(
    operations: Sequence[Operation], arranged: Iterable[int | Region]
) -> list[int | Region]:
    """Return the operations in an order in which a CPU waits less for results. Operations are
    reordered between regions and within each region. The model is a CPU that begins one operation
    per cycle. Code is traced joint by joint, arm by arm, stage by stage. This gives long chains in
    which each operation waits for the previous one, and a CPU looks at most some hundred operations
    ahead. Operations of later chains therefore move, within a window, to where an earlier chain
    waits. A wider window needs more registers than a CPU has. Measured on a tick of 4 250 vector
    operations: 4 450 cycles as traced, 3 950 with this window.
    """
    scheduled: list[int | Region] = []
    # Operations since the last region.
    between = []
    for item in arranged:
        if isinstance(item, Region):
            scheduled += _schedule(operations, between)
            scheduled.append(item._replace(operations=_schedule(operations, item.operations)))
            between = []
        else:
            between.append(item)
    return scheduled + list(_schedule(operations, between))


def _schedule(operations: Sequence[Operation], order: Sequence[int]):
    """Return operations without regions in an order with less waiting. In each cycle, the first
    operation in the window begins whose operands are available. If there is none, the operation
    begins that waits least.
    """
    # From here on operations are identified by their index in `order`.
    index = {i: k for k, i in enumerate(order)}
    # Number of operands that have not begun yet.
    missing = [0] * len(order)
    # Cycle in which the operands that have begun are available.
    ready = [0] * len(order)
    readers: list[list[int]] = [[] for _ in order]
    for k, i in enumerate(order):
        for operand in operations[i].operands:
            if (source := index.get(operand)) is not None:
                missing[k] += 1
                readers[source].append(k)
    # Operations in the window with no operand missing, in order.
    candidates = []
    result = []
    now = window_end = 0
    while len(result) < len(order):
        while window_end < min(len(result) + WINDOW, len(order)):
            if not missing[window_end]:
                candidates.append(window_end)
            window_end += 1
        k = next((k for k in candidates if ready[k] <= now), None)
        if k is None:
            k = min(candidates, key=ready.__getitem__)
        candidates.remove(k)
        result.append(order[k])
        cycles = LATENCIES.get(operations[order[k]].name, 2)
        now = max(now, ready[k])
        for reader in readers[k]:
            ready[reader] = max(ready[reader], now + cycles)
            missing[reader] -= 1
            if not missing[reader] and reader < window_end:
                bisect.insort(candidates, reader)
        now += cycles > 0
    return tuple(result)


PARAMETERS: dict[str, str] = TEXTS["parameters"]
"""Name of each function of the module -> its parameters. Strides and steps are in bytes."""
ARGUMENTS = {
    name: [parameter.split()[0] for parameter in parameters.split(", ")]
    for name, parameters in PARAMETERS.items()
}
"""Types of the arguments of each function."""
CALL_WORDS = 1 + max(map(len, ARGUMENTS.values()))
"""64-bit words of a call: the function's number and its arguments."""
FUNCTIONS = (*ARGUMENTS, "make_calls")


@dataclasses.dataclass(frozen=True)
class VectorKernel:
    """The module's text and the layout of its buffers."""

    text: str
    inputs: BufferLayout  # all inputs, of lanes
    group_inputs: BufferLayout  # all inputs, of a group
    state: BufferLayout
    group_state: BufferLayout
    prologue: BufferLayout
    row: BufferLayout
    results: BufferLayout
    outputs: int  # number of outputs of each tick


def print_kernel(split: Split, width: int, features: frozenset[str]) -> VectorKernel:
    """Generate the module of `split` for `width` parallel lanes."""
    return _LlvmModule(split, width, features).kernel()


class _LlvmModule(LoopPrinting[Place]):
    def __init__(self, split: Split, width: int, features: frozenset[str]):
        super().__init__(split)
        self.width, self.features = width, features
        first = split.loop.lane_inputs
        types = self.step.inputs[first : first + split.loop.states]
        self.lane_state = (*split.lane_state, *split.held_state)
        step, results = self.step.operations, self.finish.operations

        # A row of a buffer of lanes has `width` values of each number; that of a group has one.
        def layout(types: Iterable[str], lanes: int = width):
            return BufferLayout.of_lanes(types, lanes)

        self.buffers = VectorKernel(
            text="",
            inputs=layout(self.begin.inputs),
            group_inputs=layout(self.begin.inputs, 1),
            state=layout(types[k] for k in self.lane_state),
            group_state=layout((types[k] for k in split.shared_state), 1),
            prologue=layout(step[i].dtype for i in split.prologue_results),
            row=layout((step[i].dtype for i in split.row), 1),
            results=layout(results[i].dtype for i in self.finish.outputs),
            outputs=len(self.outputs),
        )
        self.declared: set[str] = set()
        self.functions: list[str] = []

    def kernel(self) -> VectorKernel:
        # Prints the five functions, and `make_calls`, which calls them.
        self._shared_begin()
        self._shared_run()
        self._lane_begin()
        self._lane_run()
        self._lane_finish()
        # Without these attributes, LLVM splits vectors of 512 bits on some CPUs.
        bits = self.width * 32
        widths = f'"min-legal-vector-width"="{bits}" "prefer-vector-width"="{bits}"'
        template = Path(__file__).with_name("calls.ll.j2")
        calls = resources.render_text(template, arguments=ARGUMENTS, call_words=CALL_WORDS)
        attributes = f"attributes #0 = {{ nounwind {widths} }}"
        lines = [*self.functions, f"{calls}\n", *sorted(self.declared), attributes, BRANCH_WEIGHTS]
        return dataclasses.replace(self.buffers, text="\n".join(lines))

    def _lane_state_places(self):
        # Index in the state -> place in the buffer of a lane.
        return _places_by_number(self.lane_state, self.buffers.state, "%state")

    def _group_state_places(self, pointer: str = "%state", splat: bool = False):
        # Index in the state -> place in the buffer of a group. splat: each lane reads the number.
        return _places_by_number(self.split.shared_state, self.buffers.group_state, pointer, splat)

    def _function(self, name: str, printer: LlvmPrinter):
        # Adds a function without a loop, whose body is the lines of the printer. `kernel` defines
        # its attributes, #0.
        body = "\n".join(f"  {line}" for line in printer.lines)
        head = f"define void @{name}({_noalias_parameters(name)}) #0"
        self.functions.append(f"{head} {{\nentry:\n{body}\n  ret void\n}}\n")
        self.declared |= printer.declared

    def _loop(self, name: str, printer: LlvmPrinter, steps: dict[str, str]):
        """Add a function that repeats its body. steps: pointer -> bytes it advances per tick."""
        self.functions.append(repeat_lines(name, _noalias_parameters(name), printer, steps, " #0"))
        self.declared |= printer.declared

    def _shared_begin(self):
        printer = LlvmPrinter(width=1, features=self.features)
        inputs = self.buffers.group_inputs.places("%inputs")
        self.print_begin(printer, inputs, self._group_state_places())
        self._function("shared_begin", printer)

    def _shared_run(self):
        # Prints the loop over ticks of a group. A tick reads the group's inputs and its own, writes
        # the new state of the group, and writes the numbers that lanes read to the tick's row.
        printer = LlvmPrinter(width=1, features=self.features, in_loop=True)
        split, buffers, state = self.split, self.buffers, self._group_state_places()
        sources = self.sources(self.step, buffers.group_inputs.places("%inputs"), state)
        tick_values = self._add_tick_inputs(printer, sources, shared=True)
        row = _places_by_number(split.row, buffers.row, "%row").items()
        self.print_step(printer, split.shared, sources, state, row, tick_values)
        self._loop("shared_run", printer, {"in": "%in_stride", "row": str(buffers.row.bytes)})

    def _add_tick_inputs(self, printer: LlvmPrinter, sources: dict[int, Place], shared: bool):
        """Add the places of a tick's inputs to `sources`, operation -> place. Return operation ->
        variable with the tick's number, which only the `shared` code of a group needs. In the
        code, `in` points to this tick's inputs, and `in_step` is the bytes from one to the next.
        """
        tick_values: dict[int, str] = {}
        for i, k in self.tick_reads.items():
            # Input 0 is the tick's number, which is computed. The other inputs are in memory.
            if k:
                offset = printer.op(f"mul i64 %in_step, {k - 1}")
                sources[i] = Place(printer.op(f"getelementptr i8, ptr %in, i64 {offset}"))
            elif shared:
                now = printer.op("trunc i64 %tick to i32")
                tick_values[i] = printer.op(f"add i32 %first, {now}")
        return tick_values

    def _lane_begin(self):
        # Prints the first state of a vector of lanes and the prologue: numbers that are constant in
        # time, which `lane_run` reads from the buffer `held`. Both depend on the lanes' inputs; the
        # prologue also on numbers of the state that never change.
        printer = LlvmPrinter(self.width, self.features)
        inputs, state = self.buffers.inputs.places("%inputs"), self._lane_state_places()
        self.print_begin(printer, inputs, state)
        held = _places_by_number(self.split.prologue_results, self.buffers.prologue, "%held")
        sources = self.sources(self.step, inputs, state)
        printer.run(self.step, self.split.prologue, sources, list(held.items()))
        self._function("lane_begin", printer)

    def _lane_run(self):
        # Prints the loop over ticks of `width` lanes. In a tick, the lanes read their inputs, the
        # inputs of the tick, the prologue (numbers that are constant in time) and their group's row
        # (numbers that they share in this tick). They write their new state and their outputs.
        printer = LlvmPrinter(self.width, self.features, in_loop=True)
        split, buffers, state = self.split, self.buffers, self._lane_state_places()
        sources = self.sources(self.step, buffers.inputs.places("%inputs"), state)
        self._add_tick_inputs(printer, sources, shared=False)
        sources |= _places_by_number(split.prologue_results, buffers.prologue, "%held")
        sources |= _places_by_number(split.row, buffers.row, "%row", splat=True)
        outputs = []
        # In bytes: `out_step` leads to the next output of a tick, `out_stride` to the next tick.
        for k, i in enumerate(self.outputs):
            offset = printer.op(f"mul i64 %out_step, {k}")
            outputs.append((i, Place(printer.op(f"getelementptr i8, ptr %out, i64 {offset}"))))
        stored = {k: state[k] for k in split.lane_state}
        self.print_step(printer, split.lane, sources, stored, outputs, schedule=schedule_operations)
        steps = {"in": "%in_stride", "row": str(buffers.row.bytes), "out": "%out_stride"}
        self._loop("lane_run", printer, steps)

    def _lane_finish(self):
        # Prints the results of the lanes from their last state.
        printer, buffers = LlvmPrinter(self.width, self.features), self.buffers
        state = self._lane_state_places() | self._group_state_places("%group", splat=True)
        results = buffers.results.places("%results")
        self.print_finish(printer, buffers.inputs.places("%inputs"), state, results)
        self._function("lane_finish", printer)


def _places_by_number(
    numbers: Iterable[int], layout: BufferLayout, pointer: str, splat: bool = False
):
    # Number -> place in a buffer that contains these numbers in order.
    return dict(zip(numbers, layout.places(pointer, splat), strict=True))


def _noalias_parameters(name: str) -> str:
    # Returns a function's parameters for LLVM. The buffers of a call never overlap.
    return PARAMETERS[name].replace("ptr", "ptr noalias")
