"""How far the runs of a plan need their golden runs: from when to when they run themselves, and
which go on from one.

Up to the first tick in which a fault may act a run is its golden run, to the bit. Where enough runs
share a golden run it is followed once more, beside itself, and they go on from its snapshots; where
each has its own, nothing is saved.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ravenjax.campaign.plan import Plan

WORTH = 2
"""Times that the ticks saved must exceed those of following a golden run: what its group shares
is run again, too.
"""


class Branching:
    """Of each golden run of a plan, by its number."""

    def __init__(self, ready: Plan, lanes: int) -> None:
        """lanes: that go on from their golden run together; 0: none does."""
        self._ready, self._lanes = ready, lanes
        self._size = int(ready.golden.max(initial=-1)) + 1

    @cached_property
    def last_act(self) -> np.ndarray:
        """The last tick in which faults of a run begin to act, int64 [golden runs]; 0: none ever
        does.
        """
        acts = self._ready.acts
        return self._largest(np.where(acts < self._ready.program.ticks, acts, 0))

    @cached_property
    def last_end(self) -> np.ndarray:
        """The first tick that no run needs, int64 [golden runs]."""
        return self._largest(self._ready.ends)

    @cached_property
    def branches(self) -> np.ndarray:
        """Whether runs go on from it, bool [golden runs]."""
        if not self._lanes:
            return np.zeros(self._size, bool)
        early_ends = np.where(self.early, self._ready.ends, 0)
        saved = self._summed(self._ready.acts + early_ends) / self._lanes
        return saved > WORTH * np.maximum(self.last_act, self._largest(early_ends))

    @cached_property
    def early(self) -> np.ndarray:
        """Which runs end before the last of their golden run, bool [runs]."""
        if not self._ready.program.ends:
            return np.zeros(self._ready.runs, bool)
        return self._ready.ends < self.last_end[self._ready.golden]

    def early_ends(self, number: int) -> np.ndarray:
        """The ends before its last one, int64, ascending."""
        first, last = np.searchsorted(self._sorted[0], [number, number + 1])
        ends = np.unique(self._sorted[1][first:last])
        return ends[ends < self.last_end[number]]

    @cached_property
    def _sorted(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the runs' golden runs, ascending, and the runs' ends beside them."""
        order = np.argsort(self._ready.golden, kind="stable")
        return self._ready.golden[order], self._ready.ends[order].astype(np.int64)

    def _summed(self, values: np.ndarray) -> np.ndarray:
        """The sum of the runs' values, float64 [golden runs]."""
        if self._size == 1:
            return values.sum(keepdims=True, dtype=np.float64)
        return np.bincount(self._ready.golden, values, self._size)

    def _largest(self, values: np.ndarray) -> np.ndarray:
        """The largest of the runs' values, int64 [golden runs]."""
        if self._size == 1:  # of millions of runs, mostly
            return values.max(keepdims=True).astype(np.int64)
        largest = np.zeros(self._size, np.int64)
        np.maximum.at(largest, self._ready.golden, values)
        return largest
