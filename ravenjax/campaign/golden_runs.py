"""Computes the golden runs of a campaign and decides which runs start from their checkpoints.

Up to the first tick in which a fault may act, a run equals its golden run bit by bit. If enough
runs share a golden run, it is computed a second time with checkpoints, and these runs start from
the checkpoints. If each run has a different golden run, checkpoints would save no time.
"""

from concurrent.futures import Future
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ravenjax.campaign.memory_windows import Columns, take_rows
from ravenjax.campaign.plan import Plan

MIN_SAVING = 2
"""Smallest ratio of saved ticks to the ticks of computing the golden run again with checkpoints.

Numbers that the lanes of a group share must also be computed again, so the ratio is above 1.
"""


class Computed(NamedTuple):
    """Computed golden runs, in ascending order of their numbers."""

    numbers: np.ndarray  # int [golden runs], as in Plan.golden
    reference: np.ndarray  # [ticks, series, golden runs]
    outcomes: Columns  # outcome -> [golden runs]

    def select_lanes(self, numbers: np.ndarray) -> "Computed":
        """Return those of these golden runs whose numbers are in `numbers`."""
        mask = np.isin(self.numbers, numbers)
        outcomes = take_rows(self.outcomes, mask)
        return Computed(self.numbers[mask], self.reference[:, :, mask], outcomes)

    @staticmethod
    def join(
        parts: "list[Future[Computed]]", earlier: "Future[Computed] | None", numbers: np.ndarray
    ) -> "Computed":
        """Join the golden runs of `parts` and those golden runs of `earlier` that are in `numbers`.
        `numbers`: numbers of all golden runs of the result, ascending. The list `parts` is emptied,
        so that memory of the large time series is released early.
        """
        pieces = [part.result() for part in parts]
        parts.clear()
        if earlier is not None:
            pieces.append(earlier.result().select_lanes(numbers))
        if len(pieces) == 1:
            return pieces[0]
        first = pieces[0]
        reference = np.empty((*first.reference.shape[:2], len(numbers)), first.reference.dtype)
        outcomes = {
            name: np.empty(len(numbers), values.dtype) for name, values in first.outcomes.items()
        }
        # Each piece is released as soon as it is copied, so no other variable may refer to it.
        del first
        while pieces:
            piece = pieces.pop()
            lanes = np.searchsorted(numbers, piece.numbers)
            # NumPy copies a slice several times faster than a list of consecutive indices.
            if lanes[-1] - lanes[0] < len(lanes):
                lanes = slice(lanes[0], lanes[-1] + 1)
            reference[:, :, lanes] = piece.reference
            for name, values in piece.outcomes.items():
                outcomes[name][lanes] = values
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
        self._golden_count = int(plan.golden.max(initial=-1)) + 1

    @cached_property
    def last_act(self) -> np.ndarray:
        """The last tick in which a fault of the runs begins to act, [golden runs]; 0: never."""
        acts = self._plan.acts
        # A run in which no fault acts has the number of ticks here.
        return self._largest_of_runs(np.where(acts < self._plan.program.ticks, acts, 0))

    @cached_property
    def last_end(self) -> np.ndarray:
        """The tick at which the last run of each golden run ends, int64 [golden runs]."""
        return self._largest_of_runs(self._plan.ends)

    @cached_property
    def uses_checkpoints(self) -> np.ndarray:
        """Whether the runs of each golden run start from its checkpoints, bool [golden runs]."""
        if not self._lanes:
            return np.zeros(self._golden_count, bool)
        # A run that starts from a checkpoint saves the ticks before its fault. If it ends early, it
        # also saves another golden run up to its end: checkpoints come with the outcomes there.
        early_ends = np.where(self.ends_early, self._plan.ends, 0)
        saved_of_run = self._plan.acts + early_ends
        # The ticks that `_lanes` runs save would have been computed at the same time.
        saved = np.bincount(self._plan.golden, saved_of_run, self._golden_count) / self._lanes
        # To make checkpoints, the golden run is computed again up to the last fault or early end.
        cost = np.maximum(self.last_act, self._largest_of_runs(early_ends))
        return saved > MIN_SAVING * cost

    @cached_property
    def ends_early(self) -> np.ndarray:
        """Which runs end before the last run of the same golden run, bool [runs]."""
        if not self._plan.program.ends:
            return np.zeros(self._plan.runs, bool)
        return self._plan.ends < self.last_end[self._plan.golden]

    def early_ends(self, number: int) -> np.ndarray:
        """Return the ticks at which runs of golden run `number` end, ascending, except the last."""
        golden, sorted_ends = self._sorted_ends
        first, last = np.searchsorted(golden, [number, number + 1])
        ends = np.unique(sorted_ends[first:last])
        return ends[ends < self.last_end[number]]

    @cached_property
    def _sorted_ends(self) -> tuple[np.ndarray, np.ndarray]:
        # The golden run and the end of each run, sorted by golden run.
        order = np.argsort(self._plan.golden, kind="stable")
        return self._plan.golden[order], self._plan.ends[order].astype(np.int64)

    def _largest_of_runs(self, values: np.ndarray) -> np.ndarray:
        # Returns for each golden run the largest value of its runs. values: [runs].
        largest = np.zeros(self._golden_count, np.int64)
        np.maximum.at(largest, self._plan.golden, values)
        return largest
