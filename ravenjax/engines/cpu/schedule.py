"""An order of operations in which a CPU finds enough to do while it waits for results.

Code is traced one joint, one arm, one stage after the other: long chains, each operation waiting
for the one before. A CPU looks some hundred operations ahead at most. `schedule` moves operations
of later chains up to where an earlier one would wait, as far as a window reaches: a wider one finds
more work, but keeps more numbers alive than there are registers. Measured on a tick of 4 250 vector
operations: 4 450 cycles as traced, 3 950 with this window.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Sequence

from ravenjax.ir.program import Operation
from ravenjax.ir.regions import Region

WINDOW = 200
"""Operations, from the earliest that is not placed yet, among which the next is chosen."""
LATENCIES = {
    "fma": 6,
    "mul": 6,
    "add": 5,
    "sub": 5,
    "div": 20,
    "sqrt": 30,
    "select": 3,
    "rarely": 3,
    "abs": 2,
    "neg": 0,
    "bitcast": 0,
    "rem": 60,
}
"""Cycles until a result is there, of 512-bit operations, loads and stores between included."""
_SLOW = frozenset(
    ("lt", "le", "eq", "ne", "max", "min", "convert", "truncate", "round", "floor", "ceil")
)


def latency(name: str) -> int:
    """Cycles until the result of an operation is there."""
    return LATENCIES.get(name, 6 if name in _SLOW else 2)


def schedule(
    operations: Sequence[Operation], arranged: Iterable[int | Region], window: int = WINDOW
) -> list[int | Region]:
    """Operations in an order that can be run, rearranged between regions and within each; one is
    begun each cycle.
    """
    out: list[int | Region] = []
    between: list[int] = []
    for item in arranged:
        if isinstance(item, Region):
            out += _straight(operations, between, window)
            out.append(item._replace(operations=_straight(operations, item.operations, window)))
            between = []
        else:
            between.append(item)
    return out + list(_straight(operations, between, window))


def _straight(
    operations: Sequence[Operation], order: Sequence[int], window: int
) -> tuple[int, ...]:
    """Of those whose operands are begun, the window's first that need not wait, else the first
    that waits least.
    """
    place = {i: k for k, i in enumerate(order)}  # everything below goes by places in `order`
    missing, ready = (
        [0] * len(order),
        [0] * len(order),
    )  # operands not begun yet; when those that are will be there
    readers: list[list[int]] = [[] for _ in order]
    for k, i in enumerate(order):
        for operand in operations[i].operands:
            if (source := place.get(operand)) is not None:
                missing[k] += 1
                readers[source].append(k)
    candidates: list[int] = []  # of the window, those with no operand missing, in order
    result: list[int] = []
    now = inside = 0
    while len(result) < len(order):
        while inside < min(len(result) + window, len(order)):
            if not missing[inside]:
                candidates.append(inside)
            inside += 1
        k = next((k for k in candidates if ready[k] <= now), None)
        if k is None:
            k = min(candidates, key=ready.__getitem__)
        candidates.remove(k)
        result.append(order[k])
        cycles = latency(operations[order[k]].name)
        now = max(now, ready[k])
        for reader in readers[k]:
            ready[reader] = max(ready[reader], now + cycles)
            missing[reader] -= 1
            if not missing[reader] and reader < inside:
                bisect.insort(candidates, reader)
        now += cycles > 0
    return tuple(result)
