"""An order of operations in which a CPU finds enough to do while it waits for results.

Code is traced one joint, one arm, one stage after the other: long chains, each operation waiting for the one before. A
CPU looks some hundred operations ahead at most. `schedule` moves operations of later chains up to where an earlier one
would wait, as far as a window reaches: a wider one finds more work, but keeps more numbers alive than there are
registers. Measured on a tick of 4 250 vector operations: 4 450 cycles as traced, 3 950 with this window.
"""

from __future__ import annotations

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
_SLOW = frozenset(("lt", "le", "eq", "ne", "max", "min", "convert", "truncate", "round", "floor", "ceil"))


def latency(name: str) -> int:
    """Cycles until the result of an operation is there."""
    return LATENCIES.get(name, 6 if name in _SLOW else 2)


def schedule(
    operations: Sequence[Operation], arranged: Iterable[int | Region], window: int = WINDOW
) -> list[int | Region]:
    """Operations in an order that can be run, rearranged between regions and within each; one is begun each cycle."""
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


def _straight(operations: Sequence[Operation], order: Sequence[int], window: int) -> tuple[int, ...]:
    here = set(order)
    due: dict[int, int] = {}  # when the result of a placed operation is there
    waiting: list[int] = []  # the window, in order
    placed: list[int] = []
    now = next_place = 0
    while len(placed) < len(order):
        if len(waiting) < window and next_place < len(order):
            more = order[next_place : next_place + window - len(waiting)]
            waiting.extend(more)
            next_place += len(more)
        best, best_time = 0, None
        for k, i in enumerate(waiting):
            ready = _ready(operations[i].operands, here, due)
            if ready is not None and (best_time is None or ready < best_time):
                best, best_time = k, ready
                if ready <= now:
                    break
        i = waiting.pop(best)
        now = max(now, best_time or 0)
        due[i] = now + latency(operations[i].name)
        placed.append(i)
        now += latency(operations[i].name) > 0
    return tuple(placed)


def _ready(operands: Sequence[int], here: set[int], due: dict[int, int]) -> int | None:
    """When all operands are there; None while one is not even begun."""
    time = 0
    for operand in operands:
        if operand in here:
            result = due.get(operand)
            if result is None:
                return None
            time = max(time, result)
    return time
