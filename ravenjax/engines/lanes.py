"""The lanes that a compiled time loop of any target runs: what it reads and writes for them, and
from where they go on.
"""

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


EVERY = 25
"""Ticks from one snapshot to the next, where memory allows."""
STATE_BYTES = 2**12
"""More than the state of a lane, and of what its group shares, takes: 1.3 kB with one arm and
two faults.
"""
SNAPSHOT_BYTES = 2**26
"""Memory that the snapshots of one golden run may take."""


@dataclasses.dataclass(frozen=True, eq=False)
class Trunk:
    """Snapshots of a golden run that is compared with itself."""

    every: int  # ticks from one to the next; the first is that of the beginning
    group: np.ndarray  # uint32 [snapshots, words], what its group shares
    lane: np.ndarray  # uint32 [snapshots, words], of one lane

    @staticmethod
    def room(every: int, snapshots: int, group: int, lane: int) -> Trunk:
        """Room for `snapshots`, of these numbers of words each."""
        return Trunk(
            every, np.empty((snapshots, group), np.uint32), np.empty((snapshots, lane), np.uint32)
        )

    def begins(self, first: np.ndarray) -> np.ndarray:
        """Tick from which runs can go on whose faults act in tick `first` (int) at the earliest;
        0: they run whole.
        """
        return np.clip((first - 1) // self.every, 0, len(self.lane) - 1) * self.every


def snapshot_bytes(ticks: int) -> int:
    """Memory that the snapshots of a golden run of so many ticks may take, at most."""
    return min(SNAPSHOT_BYTES, (ticks // EVERY + 1) * STATE_BYTES)


def spacing(last: int, words: int) -> int:
    """Ticks between snapshots of so many words up to tick `last`."""
    most = max(1, SNAPSHOT_BYTES // max(4 * words, 1))
    return max(EVERY, -(-last // most))
