"""Finds operations that are needed only in rare cases, so that generated code can skip them.

A `rarely` operation selects one of two values by a condition that is seldom true. Some operations
are needed only to compute the second value of `rarely` operations with the same condition. These
operations form the *region* of the condition. Generated code enters the region as a block if the
condition is true in any lane.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from ravenjax.ir.program import Operation

MIN_OPERATIONS = 16
"""Least number of operations of a region, because a branch costs more than a few operations."""


class Region(NamedTuple):
    """Operations that are needed only in lanes where `condition` is true."""

    condition: int
    operations: tuple[int, ...]
    results: tuple[int, ...]  # read outside: by choices, and by a later region of the condition

    def reads(self, operations: Sequence[Operation]) -> list[int]:
        """Return the operations outside the region whose results it reads."""
        inside = set(self.operations)
        inputs = (o for i in self.operations for o in operations[i].operands if o not in inside)
        return list(dict.fromkeys(inputs))


def flatten_regions(arranged: Iterable[int | Region]) -> Iterator[int]:
    """Yield every operation; the operations of a region come at the region's position."""
    for item in arranged:
        yield from item.operations if isinstance(item, Region) else (item,)


def arrange_regions(
    operations: Sequence[Operation], order: Sequence[int], results: Sequence[int]
) -> list[int | Region]:
    """Return the operations of `order` with the operations of each region joined.

    order: operations, each after its operands. A region comes before its results are first read.
    results: operations whose results are read outside `order`.
    """
    region_condition = _region_conditions(operations, order, results)
    readers: dict[int, list[int]] = {}
    for i in order:
        for operand in operations[i].operands:
            readers.setdefault(operand, []).append(i)
    unplaced = set(order)  # not placed yet
    arranged: list[int | Region] = []
    for i in order:
        if i in region_condition:
            continue
        if any(o in region_condition and o in unplaced for o in operations[i].operands):
            condition = operations[i].operands[0]
            # Members of the region that depend only on each other and on placed operations.
            ready: dict[int, None] = {}
            for member in order:
                is_member = member in unplaced and region_condition.get(member) == condition
                if is_member and ready.keys() >= unplaced.intersection(operations[member].operands):
                    ready[member] = None
            unplaced.difference_update(ready)
            if len(ready) < MIN_OPERATIONS:
                arranged += ready
            else:
                outside = (member for member in ready if not ready.keys() >= {*readers[member]})
                arranged.append(Region(condition, tuple(ready), tuple(outside)))
        unplaced.discard(i)
        arranged.append(i)
    return arranged


def _region_conditions(
    operations: Sequence[Operation], order: Sequence[int], results: Sequence[int]
):
    """Return operation -> condition of its outermost region, for operations in a region.

    Goes backwards from the results. An operation is in the region of a condition if all operations
    that read it are, or read it as the rare value of a `rarely` with this condition.
    """
    in_order = set(order)
    # operation -> conditions under which its readers need it; None: they always need it
    wanted: dict[int, set[int | None]] = {i: {None} for i in results}
    region_condition = {}
    for i in reversed(order):
        conditions = wanted.get(i, {None})
        (only,) = conditions if len(conditions) == 1 else (None,)
        if only is not None:
            region_condition[i] = only
        operation = operations[i]
        for position, operand in enumerate(operation.operands):
            if operand in in_order:
                # Operands of `rarely`: condition, rare value, usual value.
                is_rare_value = operation.name == "rarely" and position == 1
                opens_region = is_rare_value and i not in region_condition
                wanted.setdefault(operand, set()).add(
                    operation.operands[0] if opens_region else region_condition.get(i)
                )
    return region_condition
