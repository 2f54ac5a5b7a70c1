"""The golden runs that runs are compared with: each computed once, kept while the next runs may need it."""

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


def _joined(some: Sequence[Computed]) -> Computed:
    """All of them, of which no two hold the same golden run."""
    if len(some) == 1:
        return some[0]
    numbers = np.concatenate([one.numbers for one in some])
    order = np.argsort(numbers)
    reference = np.concatenate([one.reference for one in some], axis=2)
    outcomes = {name: np.concatenate([one.outcomes[name] for one in some])[order] for name in some[0].outcomes}
    ascending = bool((order[1:] > order[:-1]).all())
    return Computed(numbers[order], reference if ascending else reference[:, :, order], outcomes)


class GoldenRuns:
    """The golden runs of a stretch of runs; those that are still computed are waited for by who first needs them."""

    def __init__(
        self, numbers: np.ndarray, coming: Sequence[Future[Computed]], earlier: GoldenRuns | None = None
    ) -> None:
        """numbers: ascending; each is in one of `coming` or in `earlier`, whose `branches` these have as well."""
        self.numbers = numbers
        self.branches: dict[int, Future[Branches]]
        self.branches = {} if earlier is None else {n: b for n, b in earlier.branches.items() if n in numbers}
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
                self._computed = _joined(parts)
                self._coming, self._earlier = (), None
            return self._computed

    def followed(self, numbers: np.ndarray, compute: Callable[[np.ndarray], Sequence[Future[Computed]]]) -> GoldenRuns:
        """Those `numbers` (ascending) that the next stretch needs; `compute` starts those that are not among these."""
        here = np.isin(numbers, self.numbers)
        if here.all():
            return self
        return GoldenRuns(numbers, compute(numbers[~here]), self if here.any() else None)
