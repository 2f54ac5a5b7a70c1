"""Defines the base class of printers, which write a program in a language such as LLVM IR.

A subclass defines the text of constants, loads, stores, operations and conditional blocks. A value
is loaded where an operation first needs it, and a result is stored as soon as it is computed. If a
result overwrites a value in memory, the old value is loaded before the store.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, TypeVar

from ravenjax.ir.program import Program
from ravenjax.ir.regions import Region, arrange_regions, flatten_regions
from ravenjax.ir.time_loop import Split

Where = TypeVar("Where")
"""The address of a number in memory, as the printer of a language represents it."""


class Printing(ABC, Generic[Where]):
    """Collects the lines of one function body."""

    def __init__(self):
        self.lines: list[str] = []
        self._count = 0

    def run(
        self,
        program: Program,
        operations: Iterable[int | Region],
        sources: Mapping[int, Where],
        results: Sequence[tuple[int, Where]],
        given: Mapping[int, str] | None = None,
    ) -> None:
        """Print statements that read numbers, compute operations and write results.

        operations: operations of `program` in order. A region becomes a block that is skipped if
        its condition is false. sources: operation -> place of its number in memory. results:
        (operation, place to write to). given: operation -> name of a variable that the code around
        these statements has for it.
        """
        operations = list(operations)
        types = [operation.dtype for operation in program.operations]
        values: dict[int, str] = dict(given or {})
        read = {o for i in flatten_regions(operations) for o in program.operations[i].operands}
        read.update(i for i, _ in results)
        # Place -> operation whose number is there at first, if the number is needed.
        old_number_at = {place: i for i, place in sources.items() if i in read}
        # Operation whose number is loaded later -> (operation, place) of stores that wait for it.
        waiting: dict[int, list[tuple[int, Where]]] = {}

        def get_value(i: int):
            # Returns the text of number `i`. At its first use, a number in memory is loaded.
            if i not in values:
                operation = program.operations[i]
                if operation.name == "constant":
                    values[i] = self._constant(operation.dtype, operation.value)
                else:
                    values[i] = self._load(types[i], sources[i])
                    # After the load, results that replace this number in memory can be stored.
                    write(waiting.pop(i, []))
            return values[i]

        def write(pending: Iterable[tuple[int, Where]]):
            # Stores values at their places; those whose old value is still unread wait.
            for i, place in pending:
                before = old_number_at.get(place)
                if before is not None and before not in values:
                    waiting.setdefault(before, []).append((i, place))
                else:
                    self._store(types[i], get_value(i), place)

        targets: dict[int, list[tuple[int, Where]]] = {}
        for i, place in results:
            # A number that is already at its place needs no store.
            if sources.get(i) != place:
                targets.setdefault(i, []).append((i, place))

        def is_given(i: int):
            return i in sources or i in values or program.operations[i].name == "constant"

        outside = set(filter(is_given, targets))

        def compute(i: int):
            # Prints one operation, and stores its result if it is a result of the function.
            if is_given(i):
                return
            operation = program.operations[i]
            values[i] = self._operation(program, i, [get_value(o) for o in operation.operands])
            write(targets.get(i, []))

        def enter(region: Region):
            # Prints a region. Its values, except its results, do not exist after the block.
            # Loads before the block what the region reads, because later operations may read it.
            for o in region.reads(program.operations):
                get_value(o)
            condition, before = get_value(region.condition), dict(values)
            end = self._begin_region(condition, [types[i] for i in region.results])
            for i in region.operations:
                compute(i)
            results = self._end_region(end, [values[i] for i in region.results])
            values.clear()
            values.update(before | dict(zip(region.results, results, strict=True)))

        for item in operations:
            if isinstance(item, Region):
                enter(item)
            else:
                compute(item)
        for i in outside:
            get_value(i)
        old_number_at.clear()
        for pending in (*(targets[i] for i in outside), *waiting.values()):
            write(pending)

    @abstractmethod
    def _constant(self, dtype: str, value: Any) -> str:
        """Return the text of a constant."""

    @abstractmethod
    def _load(self, dtype: str, place: Where) -> str:
        """Return a new value: the number at a place."""

    @abstractmethod
    def _store(self, dtype: str, value: str, place: Where) -> None:
        """Write a number to a place."""

    @abstractmethod
    def _operation(self, program: Program, i: int, inputs: list[str]) -> str:
        """Return a new value: the result of operation `i`."""

    @abstractmethod
    def _begin_region(self, condition: str, types: list[str]) -> Any:
        """Begin a block for lanes in which `condition` is true; return data for `_end_region`."""

    @abstractmethod
    def _end_region(self, begun: Any, results: list[str]) -> list[str]:
        """End the block; return its results as new values, arbitrary in lanes that skipped it."""


class LoopPrinting(Generic[Where]):
    """Prints the functions of a split time loop, for all lanes of a group or for one lane. `state`
    of the methods: index of a number in the state -> its place in memory.
    """

    def __init__(self, split: Split):
        self.split, loop = split, split.loop
        self.step, self.begin, self.finish = loop.step, loop.begin, loop.finish
        self.outputs = loop.step.outputs[loop.states :]
        # The inputs of `step` are those of the lane, the state, then those of the tick.
        first = loop.lane_inputs + loop.states
        # Operation that reads an input of the tick -> index of this input; 0: the tick's number.
        self.tick_reads = {i: k - first for i, k in loop.step.reads.items() if k >= first}

    @staticmethod
    def sources(
        program: Program, inputs: Sequence[Where], state: Mapping[int, Where]
    ) -> dict[int, Where]:
        """Return operation -> place, for the operations that read a lane's inputs or state."""
        # The inputs of a program are those of the lane, then the state.
        places = dict(enumerate(inputs)) | {len(inputs) + k: at for k, at in state.items()}
        return {i: places[k] for i, k in program.reads.items() if k in places}

    def print_begin(
        self, printer: Printing[Where], inputs: Sequence[Where], state: Mapping[int, Where]
    ) -> None:
        """Print the statements that compute the first state and write it to the places `state`."""
        results = [(self.begin.outputs[k], place) for k, place in state.items()]
        needed = self.begin.needed(i for i, _ in results)
        printer.run(self.begin, needed, self.sources(self.begin, inputs, {}), results)

    def print_step(
        self,
        printer: Printing[Where],
        operations: Sequence[int],
        sources: Mapping[int, Where],
        state: Mapping[int, Where],
        outputs: Iterable[tuple[int, Where]],
        given: Mapping[int, str] | None = None,
        schedule: Callable[..., list[int | Region]] = lambda _, order: order,
    ) -> None:
        """Print the statements that compute these operations of a tick. They write the new state to
        the places `state`, and other results to `outputs`, pairs (operation, place). schedule: (all
        operations, order) -> another valid order. See `Printing.run` for sources and given.
        """
        new_state = [(self.step.outputs[k], place) for k, place in state.items()]
        results = [*new_state, *outputs]
        order = arrange_regions(self.step.operations, operations, [i for i, _ in results])
        order = schedule(self.step.operations, order)
        printer.run(self.step, order, sources, results, given)

    def print_finish(
        self,
        printer: Printing[Where],
        inputs: Sequence[Where],
        state: Mapping[int, Where],
        results: Iterable[Where],
    ) -> None:
        """Print the statements that compute a lane's results and write them to their places."""
        # Pairs, not a dict, because two results may be the same operation.
        pairs = list(zip(self.finish.outputs, results, strict=True))
        sources = self.sources(self.finish, inputs, state)
        printer.run(self.finish, self.finish.needed(), sources, pairs)
