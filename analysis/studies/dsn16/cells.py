"""What the counts of the targeted attacks say: shares of cells, bias, the alarm's window.

A cell is one fault (a value and a duration); the runs in it differ in the packet that it starts at,
and in how long packets last where that is drawn. Values, durations and onsets are a fixed grid and
the robot has no noise, so a predicted share has no interval; what the draws of packets do to it,
variants with other draws tell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from studies.framework.study import StudyEstimate

DURATIONS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Packets that a fault lasts, in both scenarios."""


def inside(ended: np.ndarray, start: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Whether a first jump counts for the published analysis when it only looks at packets t1 to t1
    + d + 1.

    ended: packet that ends the second long step, as the monitor notes it, 0 never; the jump's own
    packet is two before. start, duration: packets.
    """
    packet = np.asarray(ended) - 2
    return (
        (np.asarray(ended) > 0) & (packet >= start) & (packet <= np.asarray(start) + duration + 1)
    )


class CellShares(NamedTuple):
    """A share in each cell."""

    values: np.ndarray  # [V] of the fault, ascending
    durations: np.ndarray  # [D] packets, ascending
    shares: np.ndarray  # [V, D], NaN where there is no run

    def of(self, duration: int) -> np.ndarray:
        """Of all values held for so many packets, [V]. KeyError where there is no such duration."""
        place = np.flatnonzero(self.durations == duration)
        if not len(place):
            raise KeyError(
                f"no fault lasts {duration} packets; there are {self.durations.tolist()}"
            )
        return self.shares[:, place[0]]

    @property
    def by_size(self) -> np.ndarray:
        """The shares with values in the order of their magnitude, [V, D]."""
        return self.shares[np.argsort(np.abs(self.values))]

    @property
    def alike(self) -> int:
        """Cells whose runs all come out the same."""
        return int(((self.shares == 0.0) | (self.shares == 1.0)).sum())


def means(value: np.ndarray, duration: np.ndarray, hit: np.ndarray) -> CellShares:
    """Share of runs with `hit` (bool [n]) in each cell of value [n] and duration [n]."""
    values, row = np.unique(value, return_inverse=True)
    durations, column = np.unique(duration, return_inverse=True)
    place, size = row * len(durations) + column, len(values) * len(durations)
    with np.errstate(invalid="ignore"):
        shares = np.bincount(place, np.asarray(hit, float), size) / np.bincount(
            place, minlength=size
        )
    return CellShares(values, durations, shares.reshape(len(values), len(durations)))


def rate(cells: np.ndarray) -> StudyEstimate:
    """Mean of the cells' shares [n], in %. ValueError for none."""
    shares = np.asarray(cells, float)
    if shares.ndim != 1 or not len(shares):
        raise ValueError(f"a rate over cells needs shares [n], got shape {shares.shape}")
    return StudyEstimate(100.0 * float(shares.mean()), n=len(shares), of="cells of a fixed grid")


class Bias(NamedTuple):
    """Signs of differences, prediction minus publication."""

    above: int
    below: int
    p: float  # two-sided, of as uneven a split of fair signs; 1 where there is no difference at all

    @property
    def words(self) -> str:
        """The split in words."""
        return f"{self.above} above, {self.below} below"


def bias(predicted: np.ndarray, published: np.ndarray, reading_error: float = 0.0) -> Bias:
    """Exact sign test; a difference within the reading error of the publication is none."""
    from scipy.stats import binomtest

    apart = np.asarray(predicted, float) - np.asarray(published, float)
    above, below = int((apart > reading_error).sum()), int((apart < -reading_error).sum())
    p = float(binomtest(above, above + below).pvalue) if above + below else 1.0
    return Bias(above, below, p)


def in_band(value: float, band: tuple[float, float]) -> bool:
    """Whether a value lies in a band, ends included."""
    return bool(band[0] <= value <= band[1])
