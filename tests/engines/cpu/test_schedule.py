"""The order of operations is that of a search through the whole window for each of them."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.engines.cpu import kernel
from ravenjax.ir.program import Operation


def searched(operations, order, window):
    """As `schedule` for a straight stretch, each operation looked at anew each time."""
    due, waiting, placed, now = {}, [], [], 0

    def there(i):
        times = [due.get(operand) for operand in operations[i].operands if operand in order]
        return None if None in times else max(times, default=0)

    while len(placed) < len(order):
        waiting = [i for i in order[: len(placed) + window] if i not in due]
        ready = [(there(i), i) for i in waiting if there(i) is not None]
        soon = [i for time, i in ready if time <= now]
        i = soon[0] if soon else min(ready, key=lambda one: one[0])[1]
        now = max(now, there(i))
        due[i] = now + kernel.latency(operations[i].name)
        placed.append(i)
        now += kernel.latency(operations[i].name) > 0
    return placed


@pytest.mark.parametrize("window", [1, 3, 20, 200])
@pytest.mark.parametrize("reach", [2, 10, 120])
def test_orders_are_those_of_the_search(window, reach):
    rng = np.random.default_rng(window * 1000 + reach)
    names = ("fma", "add", "neg", "div", "lt", "select", "input")
    operations = [
        Operation(
            str(rng.choice(names)),
            "float32",
            tuple(rng.integers(max(0, i - reach), i, min(i, 2)).tolist()),
        )
        for i in range(150)
    ]
    order = np.flatnonzero(
        rng.random(150) < 0.8
    ).tolist()  # what is not among them is there from the beginning
    found = kernel.schedule(operations, order, window)
    assert found == searched(operations, order, window)
    assert window > 1 or found == order


def test_nothing_to_order():
    assert kernel.schedule([], []) == []
