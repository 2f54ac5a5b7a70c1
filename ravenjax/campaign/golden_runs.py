"""Computes the golden runs of a campaign and decides which runs start from their checkpoints.

Up to the first tick in which a fault may act, a run equals its golden run bit by bit. If enough
runs share a golden run, it is computed a second time with checkpoints, and these runs start from
the checkpoints. If each run has a different golden run, checkpoints would save no time.
"""

from __future__ import annotations

from concurrent.futures import Future
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ravenjax.campaign.memory_windows import Columns, take_rows
from ravenjax.campaign.plan import Plan

WORTH = 2
"""Smallest ratio of saved ticks to the ticks of computing the golden run again with checkpoints.

Numbers that the lanes of a group share must also be computed again, so the ratio is above 1.
"""


class Computed(NamedTuple):
    """Computed golden runs, in ascending order of their numbers."""

    numbers: np.ndarray  # int [golden runs], as in Plan.golden
    reference: np.ndarray  # [ticks, series, golden runs]
    outcomes: Columns  # outcome -> [golden runs]

    def select_lanes(self, numbers: np.ndarray) -> Computed:
        """Return the golden runs among `numbers` that are held here."""
        mask = np.isin(self.numbers, numbers)
        outcomes = take_rows(self.outcomes, mask)
        return Computed(self.numbers[mask], self.reference[:, :, mask], outcomes)

    @staticmethod
    def join(
        parts: list[Future[Computed]], earlier: Future[Computed] | None, numbers: np.ndarray
    ) -> Computed:
        """Join the golden runs of `parts` and those golden runs of `earlier` that are in `numbers`.

        `numbers`: numbers of all golden runs of the result, ascending. The list `parts` is emptied,
        so that memory of the large time series is released early.
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
            if places[-1] - places[0] < len(places):
                # NumPy copies a slice several times faster than a list of places.
                places = slice(places[0], places[-1] + 1)
            reference[:, :, places] = computed.reference
            for name, values in computed.outcomes.items():
                outcomes[name][places] = values
        return Computed(numbers, reference, outcomes)


class Branches(NamedTuple):
    """Checkpoints of one golden run, and its outcomes at the ends of its runs."""

    trunk: Any  # checkpoints, for `Block.trunks`
    ends: np.ndarray  # int [ends], ascending, ticks at which runs end
    outcomes: Columns  # outcome -> [ends], outcomes of the golden run if it ended at these ticks


class GoldenRuns(NamedTuple):
    """The golden runs of a window of rows, perhaps not yet computed."""

    numbers: np.ndarray  # numbers of golden runs, ascending
    computed: Future[Computed]
    branches: dict[int, Future[Branches]]


class FastForwardPlan:
    """Decides which runs of a plan start from checkpoints of their golden run, and when runs end.

    Arrays [golden runs] are indexed by the number of the golden run.
    """

    def __init__(self, plan: Plan, lanes: int):
        """lanes: number of lanes that start from a checkpoint together; 0: use no checkpoints."""
        self._plan, self._lanes = plan, lanes
        self._size = int(plan.golden.max(initial=-1)) + 1

    @cached_property
    def last_act(self) -> np.ndarray:
        """The last tick in which faults of a run begin to act, int64 [golden runs]; 0: never."""
        acts = self._plan.acts
        return self._largest(np.where(acts < self._plan.program.ticks, acts, 0))

    @cached_property
    def last_end(self) -> np.ndarray:
        """The tick at which the last run of each golden run ends, int64 [golden runs]."""
        return self._largest(self._plan.ends)

    @cached_property
    def branches(self) -> np.ndarray:
        """Whether runs start from checkpoints of the golden run, bool [golden runs]."""
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
        """Return the different ends of a golden run's runs, without the last, int64, ascending."""
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
            # This is faster for campaigns of millions of runs.
            return values.max(keepdims=True).astype(np.int64)
        largest = np.zeros(self._size, np.int64)
        np.maximum.at(largest, self._plan.golden, values)
        return largest
