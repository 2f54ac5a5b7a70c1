"""The golden runs that runs are compared with: each computed once, kept while the next runs may
need it.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, NamedTuple

import numpy as np

Columns = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True, eq=False)
class Computed:
    """Golden runs that are there, in ascending order of their numbers."""

    numbers: np.ndarray  # int [golden runs], as in Plan.golden
    reference: np.ndarray  # [ticks, series, golden runs]
    outcomes: Columns  # outcome -> [golden runs]

    def picked(self, numbers: np.ndarray) -> Computed:
        """Those of `numbers` that are here."""
        mask = np.isin(self.numbers, numbers)
        outcomes = {name: values[mask] for name, values in self.outcomes.items()}
        return Computed(self.numbers[mask], self.reference[:, :, mask], outcomes)


class Branches(NamedTuple):
    """What runs of one golden run need of it on its way."""

    trunk: Any  # as `Block.trunks` takes it
    ends: np.ndarray  # int [ends], ascending
    outcomes: Columns  # outcome -> [ends], as of a golden run that ends there


def _joined(some: list[Computed]) -> Computed:
    """All of them, of which no two hold the same golden run. Takes them from the list one by
    one: series are large.
    """
    if len(some) == 1:
        return some.pop()
    numbers = np.sort(np.concatenate([one.numbers for one in some]))
    first = some[0]
    reference = np.empty((*first.reference.shape[:2], len(numbers)), first.reference.dtype)
    outcomes = {
        name: np.empty(len(numbers), values.dtype) for name, values in first.outcomes.items()
    }
    del first
    while some:
        one = some.pop()
        places = np.searchsorted(numbers, one.numbers)
        reference[:, :, places] = one.reference
        for name, values in one.outcomes.items():
            outcomes[name][places] = values
    return Computed(numbers, reference, outcomes)


class GoldenRuns:
    """The golden runs of a stretch of runs; those that are still computed are waited for by who
    first needs them.
    """

    def __init__(
        self,
        numbers: np.ndarray,
        coming: Sequence[Future[Computed]],
        earlier: GoldenRuns | None = None,
    ) -> None:
        """numbers: ascending; each is in one of `coming` or in `earlier`, whose `branches` these
        have as well.
        """
        self.numbers = numbers
        self.branches: dict[int, Future[Branches]]
        self.branches = (
            {} if earlier is None else {n: b for n, b in earlier.branches.items() if n in numbers}
        )
        self._coming, self._earlier = coming, earlier
        self._computed: Computed | None = None
        self._lock = threading.Lock()

    def get(self) -> Computed:
        """All of them, once they are there."""
        with self._lock:
            if self._computed is None:
                parts = [future.result() for future in self._coming]
                if self._earlier is not None:
                    parts.append(self._earlier.get().picked(self.numbers))
                self._coming, self._earlier = (), None
                self._computed = _joined(parts)
            return self._computed

    def followed(
        self, numbers: np.ndarray, compute: Callable[[np.ndarray], Sequence[Future[Computed]]]
    ) -> GoldenRuns:
        """Those `numbers` (ascending) that the next stretch needs; `compute` starts those that
        are not among these.
        """
        here = np.isin(numbers, self.numbers)
        if here.all():
            return self
        return GoldenRuns(numbers, compute(numbers[~here]), self if here.any() else None)
