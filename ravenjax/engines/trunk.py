"""A golden run on the way: its whole state every so many ticks, from which runs go on that are
still the same.

Up to the first tick in which a fault may act a run is its golden run, counters and accumulators
included. Of the slots of its faults only the channel's number of the tick before is its own, and
one tick before the window sets that anew.
"""

from __future__ import annotations

import dataclasses

import numpy as np

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
        """Room for so many of so many words."""
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
