"""Holds the golden runs of a plan, and decides which runs start from snapshots of them.

Up to the first tick in which a fault may act, a run equals its golden run bit by bit. If enough
runs share a golden run, the golden run is computed once more with snapshots, and the runs start
from these. If each run has a different golden run, snapshots would save nothing.
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import Future
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ravenjax.campaign.memory_windows import Columns, take_rows
from ravenjax.campaign.plan import Plan

WORTH = 2
"""How many times the saved ticks must exceed those of computing the golden run with snapshots.

What the group shares must also be computed again.
"""


@dataclasses.dataclass(frozen=True, eq=False)
class Computed:
    """Finished golden runs, in ascending order of their numbers."""

    numbers: np.ndarray  # int [golden runs], as in Plan.golden
    reference: np.ndarray  # [ticks, series, golden runs]
    outcomes: Columns  # outcome -> [golden runs]

    def select_lanes(self, numbers: np.ndarray) -> Computed:
        """Return the golden runs among `numbers` that are held here."""
        mask = np.isin(self.numbers, numbers)
        outcomes = take_rows(self.outcomes, mask)
        return Computed(self.numbers[mask], self.reference[:, :, mask], outcomes)


class Branches(NamedTuple):
    """What the runs of one golden run need from it: snapshots, and outcomes at early ends."""

    trunk: Any  # as `Block.trunks` takes it
    ends: np.ndarray  # int [ends], ascending: ticks at which runs end
    # outcome -> [ends]: outcomes of a golden run that ends there.
    outcomes: Columns


class GoldenRuns(NamedTuple):
    """The golden runs of a window."""

    numbers: np.ndarray  # ascending
    computed: Future[Computed]
    branches: dict[int, Future[Branches]]


def join_computed(
    parts: list[Future[Computed]], earlier: Future[Computed] | None, numbers: np.ndarray
) -> Computed:
    """Join the golden runs of `parts` and those of `earlier` that are among `numbers`.

    `numbers`: ascending numbers of all golden runs of the result. Empties `parts`, because series
    are large.
    """
    some = [part.result() for part in parts]
    parts.clear()
    if earlier is not None:
        some.append(earlier.result().select_lanes(numbers))
    if len(some) == 1:
        return some[0]
    first = some[0]
    reference = np.empty((*first.reference.shape[:2], len(numbers)), first.reference.dtype)
    outcomes = {
        name: np.empty(len(numbers), values.dtype) for name, values in first.outcomes.items()
    }
    del first
    while some:
        computed = some.pop()
        places = np.searchsorted(numbers, computed.numbers)
        reference[:, :, places] = computed.reference
        for name, values in computed.outcomes.items():
            outcomes[name][places] = values
    return Computed(numbers, reference, outcomes)


class FastForwardPlan:
    """Decides from which tick to which the runs of a plan are computed, and which start from their
    golden run.

    Arrays are indexed by the number of the golden run.
    """

    def __init__(self, plan: Plan, lanes: int) -> None:
        """lanes: lanes that start from their golden run together; 0: none does."""
        self._plan, self._lanes = plan, lanes
        self._size = int(plan.golden.max(initial=-1)) + 1

    @cached_property
    def last_act(self) -> np.ndarray:
        """The last tick in which faults of a run begin to act, int64 [golden runs]; 0: never."""
        acts = self._plan.acts
        return self._largest(np.where(acts < self._plan.program.ticks, acts, 0))

    @cached_property
    def last_end(self) -> np.ndarray:
        """The first tick that no run needs, int64 [golden runs]."""
        return self._largest(self._plan.ends)

    @cached_property
    def branches(self) -> np.ndarray:
        """Whether runs start from snapshots of the golden run, bool [golden runs]."""
        if not self._lanes:
            return np.zeros(self._size, bool)
        early_ends = np.where(self.early, self._plan.ends, 0)
        ticks = np.bincount(self._plan.golden, self._plan.acts + early_ends, self._size)
        saved = ticks / self._lanes
        return saved > WORTH * np.maximum(self.last_act, self._largest(early_ends))

    @cached_property
    def early(self) -> np.ndarray:
        """Which runs end before the last run of the same golden run, bool [runs]."""
        if not self._plan.program.ends:
            return np.zeros(self._plan.runs, bool)
        return self._plan.ends < self.last_end[self._plan.golden]

    def early_ends(self, number: int) -> np.ndarray:
        """Return the ends of runs before the last one, int64, ascending."""
        first, last = np.searchsorted(self._sorted[0], [number, number + 1])
        ends = np.unique(self._sorted[1][first:last])
        return ends[ends < self.last_end[number]]

    @cached_property
    def _sorted(self) -> tuple[np.ndarray, np.ndarray]:
        order = np.argsort(self._plan.golden, kind="stable")
        return self._plan.golden[order], self._plan.ends[order].astype(np.int64)

    def _largest(self, values: np.ndarray) -> np.ndarray:
        # Returns for each golden run the largest value of its runs.
        if self._size == 1:
            # Short cut for campaigns of millions of runs.
            return values.max(keepdims=True).astype(np.int64)
        largest = np.zeros(self._size, np.int64)
        np.maximum.at(largest, self._plan.golden, values)
        return largest
