"""What the compiled time loop of any target reads and writes for the lanes that it runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class Lanes:
    """Lanes that run together; on a CPU, whole vectors of one group.

    What enters a tick is [ticks, numbers, lanes], or, where it is alike in a group, [ticks,
    numbers] of the CPU's group and [groups, ticks, numbers] of a GPU's. On a CPU one tick may stand
    for all, and they begin with tick `first`.
    """

    inputs: Sequence[np.ndarray]  # each [lanes]
    tick_inputs: np.ndarray  # what enters a tick
    tables: np.ndarray  # one after the other
    out: (
        np.ndarray | None
    )  # [ticks, numbers, lanes], written: what goes out in a tick; None: nobody asks
    first: int = 0  # of `tick_inputs` and `out`; on a GPU 0
