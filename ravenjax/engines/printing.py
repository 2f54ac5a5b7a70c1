"""Base class for printing a program in any language.

Numbers are read where they are first needed, and results are written once they are computed. A
language defines the text of constants, loads, stores, operations and regions. A result never
overwrites the old content of its place before that has been read.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from ravenjax.ir.program import Program, from_bits
from ravenjax.ir.regions import Region, flatten_regions


def render_template(template: str, **values: Any) -> str:
    """Render a template of this folder."""
    # Imported here because generated code is cached, so most processes print none.
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(values)


Where = TypeVar("Where")
"""A place in memory, as the language writes it."""


class Printing(ABC, Generic[Where]):
    """Collects the lines of one function body."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._count = 0

    def run(
        self,
        program: Program,
        operations: Iterable[int | Region],
        sources: Mapping[int, Where],
        results: Sequence[tuple[int, Where]],
        tables: str = "",
        given: Mapping[int, str] | None = None,
    ) -> None:
        """Print `operations` of `program`: read numbers from `sources` and write `results`.

        A region becomes a block that is skipped if its condition does not hold. given: numbers that
        are already values of the function; tables: pointer to the concatenated tables.
        """
        operations = list(operations)
        types = [operation.dtype for operation in program.operations]
        values: dict[int, str] = dict(given or {})
        read = {o for i in flatten_regions(operations) for o in program.operations[i].operands} | {
            i for i, _ in results
        }
        holder = {place: i for i, place in sources.items() if i in read}
        due: dict[int, list[tuple[int, Where]]] = {}

        def value(i: int) -> str:
            if i not in values:
                operation = program.operations[i]
                if operation.name == "constant":
                    values[i] = self._constant(
                        operation.dtype, from_bits(operation.dtype, operation.detail)
                    )
                else:
                    values[i] = self._load(types[i], sources[i])
                    write(due.pop(i, []))
            return values[i]

        def write(pending: Iterable[tuple[int, Where]]) -> None:
            for i, place in pending:
                before = holder.get(place)
                if before is not None and before not in values:
                    due.setdefault(before, []).append((i, place))
                else:
                    self._store(types[i], value(i), place)

        goals: dict[int, list[tuple[int, Where]]] = {}
        for i, place in results:
            # Otherwise the number stays at its place.
            if sources.get(i) != place:
                goals.setdefault(i, []).append((i, place))

        def is_given(i: int) -> bool:
            return i in sources or i in values or program.operations[i].name == "constant"

        outside = set(filter(is_given, goals))

        def compute(i: int) -> None:
            if is_given(i):
                return
            operation = program.operations[i]
            values[i] = self._operation(program, i, [value(o) for o in operation.operands], tables)
            write(goals.get(i, []))

        def enter(region: Region) -> None:
            for o in region.reads(program.operations):
                value(o)
            condition, before = value(region.condition), dict(values)
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
            value(i)
        holder.clear()
        write(
            [goal for i in outside for goal in goals[i]]
            + [goal for pending in due.values() for goal in pending]
        )

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
    def _operation(self, program: Program, i: int, inputs: list[str], tables: str) -> str:
        """Return a new value: the result of operation `i`."""

    @abstractmethod
    def _begin_region(self, condition: str, types: list[str]) -> Any:
        """Begin a block for lanes where `condition` holds; return what `_end_region` takes."""

    @abstractmethod
    def _end_region(self, begun: Any, results: list[str]) -> list[str]:
        """End the block; return its results as new values, arbitrary where it was not needed."""
