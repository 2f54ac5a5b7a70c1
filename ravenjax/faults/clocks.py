"""When windows are open on the clocks of their triggers, known before a run: arithmetic on whole
columns. NumPy only.

A clock counts up by at most one a tick: the time from 0 in tick 0, packets from 1 in tick 0, the
pedal from 0 in each phase in which it is down. As in `window`, a fault's window is open where the
clock reads `start` or more and what it reads beyond, modulo `every` where that is not 0, is less
than `duration`. Knows nothing of any robot.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Protocol

import numpy as np

NEVER = 2**62
"""In place of a reading or tick that does not come."""


class Opening(NamedTuple):
    """The window of some faults on the clock of their trigger, each int64 [faults]."""

    start: np.ndarray
    duration: np.ndarray
    every: np.ndarray  # 0: opens once

    def picked(self, which: np.ndarray) -> Opening:
        """Those of an index or a mask."""
        return Opening(*(column[which] for column in self))

    def first(self, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
        """The least reading from `low` to `high` at which it is open, NEVER where there is none."""
        reading = np.maximum(low, self.start)
        repeats = self.every > 0
        beyond = (reading - self.start) % np.where(repeats, self.every, NEVER)
        later = np.where(repeats, reading + self.every - beyond, NEVER)
        reading = np.where(beyond < self.duration, reading, later)
        return np.where(reading <= high, reading, NEVER)

    def last(self, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
        """The greatest such reading, -1 where there is none."""
        beyond = (high - self.start) % np.where(self.every > 0, self.every, NEVER)
        reading = high - np.maximum(beyond - self.duration + 1, 0)
        return np.where(reading >= np.maximum(low, self.start), reading, -1)


class Arrivals(Protocol):
    """When packets come."""

    def comes(self, rows: np.ndarray, packets: np.ndarray) -> np.ndarray:
        """Ticks in which the packets of these numbers, from 1, come in these runs; int64, beyond
        the run any.
        """
        ...

    def newest(self, rows: np.ndarray) -> np.ndarray:
        """Numbers of the packets that are the newest in the last tick of these runs, int64."""
        ...


@dataclasses.dataclass(frozen=True, eq=False)
class PedalPhases:
    """When the pedal is down in runs that do not stop before their end; in those that do, until
    then.
    """

    begins: np.ndarray  # int64 [phases], ticks in which the clock reads 0, ascending
    # int64 [phases], first ticks after them in which the pedal is up, or the run's end
    ends: np.ndarray
    # ticks by which any of these may come later; None: nobody knows
    later: int | None = 0

    def end(self, opening: Opening, ticks: int) -> np.ndarray:
        """The first tick after which none is open, 0 where none ever is."""
        after = np.zeros(len(opening.start), np.int64)
        if self.later is None:
            return np.full_like(after, ticks)
        for begin, end in zip(self.begins.tolist(), self.ends.tolist(), strict=True):
            latest = min(end + self.later, ticks)
            reading = opening.last(0, latest - begin - 1)
            tick = np.minimum(begin + self.later + reading + 1, latest)
            after = np.where(reading >= 0, np.maximum(after, tick), after)
        return after


@dataclasses.dataclass(frozen=True, eq=False)
class Clocks:
    """Those of the packets and of the pedal in the runs of a campaign."""

    arrivals: Arrivals | None  # None: a fault may stop the packets
    phases: tuple[PedalPhases, ...]
    kind: np.ndarray  # int [runs], place in `phases`
    # bool [channels], by codes: whether faults there move the pedal, other than by stopping the
    # robot
    moved: np.ndarray

    def packet_end(self, rows: np.ndarray, opening: Opening, ticks: int) -> np.ndarray:
        """The first tick after which none is open, 0 where none ever is."""
        if self.arrivals is None:
            return np.full(len(rows), ticks, np.int64)
        repeats = opening.every > 0
        newest = np.full(len(rows), ticks, np.int64)  # no packet is younger
        if repeats.any():
            newest[repeats] = self.arrivals.newest(rows[repeats])
        last = opening.last(1, newest)
        first = np.minimum(
            opening.first(1, newest), newest + 1
        )  # beyond the run where there is none
        opens = (last > 0) & (self.arrivals.comes(rows, first) < ticks)
        return np.where(
            opens, np.minimum(self.arrivals.comes(rows, np.maximum(last, 0) + 1), ticks), 0
        )

    def pedal_end(self, rows: np.ndarray, opening: Opening, ticks: int) -> np.ndarray:
        """The same of windows that count time in pedal-down, in runs where no fault moves the
        pedal.
        """
        after = np.zeros(len(rows), np.int64)
        for kind, phases in enumerate(self.phases):
            mine = self.kind[rows] == kind
            after[mine] = phases.end(opening.picked(mine), ticks)
        return after
