"""Finds operations that are needed only in rare cases, so that generated code can skip them.

A `rarely` operation is a `select` whose condition is seldom true. Operations that are needed only
if this condition is true form the *region* of the condition. Generated code skips the region if the
condition is false in all lanes.
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
        """Return the operations outside the region whose results it reads, each once."""
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
    """Return `order` with the operations of each region joined.

    The operations that only the rare value of an operation rarely(condition, rare value, usual
    value) needs are a region. The region is placed before this operation. With a = f(x),
    r = rarely(c, a, y), the order [a, y, r] becomes [y, Region(c, (a,), (a,)), r]. Few operations
    are not joined. order: operations after their operands. results: those that are read elsewhere.
    """
    region_condition = _region_conditions(operations, order, results)
    readers: dict[int, list[int]] = {}
    for i in order:
        for operand in operations[i].operands:
            readers.setdefault(operand, []).append(i)
    unplaced = set(order)
    arranged: list[int | Region] = []
    for i in order:
        if i in region_condition:
            continue
        if any(o in region_condition and o in unplaced for o in operations[i].operands):
            # Outside of regions, only `rarely` operations read members. Operand 0 is the condition.
            condition = operations[i].operands[0]
            # Members that need only each other and placed operations. The others are placed later.
            ready: dict[int, None] = {}
            for member in order:
                is_member = member in unplaced and region_condition.get(member) == condition
                if is_member and ready.keys() >= unplaced.intersection(operations[member].operands):
                    ready[member] = None
            unplaced.difference_update(ready)
            # The results of a region are its members that operations outside of the region read.
            outside = (member for member in ready if not ready.keys() >= {*readers[member]})
            region = Region(condition, tuple(ready), tuple(outside))
            arranged += ready if len(ready) < MIN_OPERATIONS else [region]
        unplaced.discard(i)
        arranged.append(i)
    return arranged


def _region_conditions(
    operations: Sequence[Operation], order: Sequence[int], results: Sequence[int]
):
    """Return operation -> condition of its outermost region, for operations in a region. An
    operation is in the region of condition c if it is needed only for the rare value of `rarely`
    operations with condition c. With a = f(x), b = g(a), r = rarely(c, b, y), the result is {a: c,
    b: c} if nothing else reads a or b. If r itself is in the region of a condition d, this is the
    outermost region of all three, so the result is {a: d, b: d, r: d}.
    """
    in_order = set(order)
    # Operation -> conditions of the regions that read it; None: it is also read outside regions.
    reading_regions: dict[int, set[int | None]] = {i: {None} for i in results}
    region_condition = {}
    # Backwards, so that all readers of an operation come before the operation.
    for i in reversed(order):
        conditions = reading_regions.get(i, {None})
        if len(conditions) == 1 and None not in conditions:
            (region_condition[i],) = conditions
        operation = operations[i]
        for position, operand in enumerate(operation.operands):
            if operand in in_order:
                # Operands of `rarely`: condition, rare value, usual value.
                is_rare_value = operation.name == "rarely" and position == 1
                begins_region = is_rare_value and i not in region_condition
                condition = operation.operands[0] if begins_region else region_condition.get(i)
                reading_regions.setdefault(operand, set()).add(condition)
    return region_condition
