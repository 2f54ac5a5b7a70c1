"""Finds operations that are needed only in rare cases, so that generated code can skip them.

A `rarely` operation selects one of two values by a condition that is seldom true. Some operations
are needed only to compute the second value of `rarely` operations with the same condition. These
operations form the *region* of the condition. Generated code enters the region as a block if the
condition is true in any lane.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from ravenjax.ir.program import Operation

LEAST = 16
"""Number of operations below which a region is not worth a branch."""


class Region(NamedTuple):
    """Operations that are needed where `condition` holds."""

    condition: int
    operations: tuple[int, ...]
    results: tuple[int, ...]  # read outside: by choices, and by a later region of the condition

    def reads(self, operations: Sequence[Operation]) -> list[int]:
        """Return the operations outside that the region reads."""
        here = set(self.operations)
        inputs = (o for i in self.operations for o in operations[i].operands if o not in here)
        return list(dict.fromkeys(inputs))


def flatten_regions(arranged: Iterable[int | Region]) -> Iterator[int]:
    """Yield every operation, those of regions at the region's position."""
    for item in arranged:
        yield from item.operations if isinstance(item, Region) else (item,)


def arrange_regions(
    operations: Sequence[Operation], order: Sequence[int], results: Sequence[int]
) -> list[int | Region]:
    """Return `order`, a valid order, with each region in one piece before it is first read.

    results: operations that are read by others than those in `order`.
    """
    label = _labels(operations, order, results)
    readers: dict[int, list[int]] = {}
    for i in order:
        for operand in operations[i].operands:
            readers.setdefault(operand, []).append(i)
    missing = set(order)  # not placed yet
    arranged: list[int | Region] = []
    for i in order:
        if i in label:
            continue
        if any(o in label and o in missing for o in operations[i].operands):
            condition = operations[i].operands[0]
            # Members that depend only on each other and on placed operations.
            ready: dict[int, None] = {}
            for member in order:
                here = member in missing and label.get(member) == condition
                if here and all(
                    o in ready or o not in missing for o in operations[member].operands
                ):
                    ready[member] = None
            missing.difference_update(ready)
            read = tuple(member for member in ready if not ready.keys() >= {*readers[member]})
            arranged += ready if len(ready) < LEAST else [Region(condition, tuple(ready), read)]
        missing.discard(i)
        arranged.append(i)
    return arranged


def _labels(
    operations: Sequence[Operation], order: Sequence[int], results: Sequence[int]
) -> dict[int, int]:
    """Return the condition of each operation's region, if any: of the outermost one."""
    here = set(order)
    wanted: dict[int, set[int | None]] = {i: {None} for i in results}
    label: dict[int, int] = {}
    for i in reversed(order):
        conditions = wanted.get(i, {None})
        (only,) = conditions if len(conditions) == 1 else (None,)
        if only is not None:
            label[i] = only
        operation = operations[i]
        for place, operand in enumerate(operation.operands):
            if operand in here:
                rare = operation.name == "rarely" and place == 1 and i not in label
                wanted.setdefault(operand, set()).add(
                    operation.operands[0] if rare else label.get(i)
                )
    return label
