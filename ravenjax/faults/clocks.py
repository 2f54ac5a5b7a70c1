"""Computes, before a run, in which ticks its faults are active.

A fault is active while its *window* is open. A *clock* counts ticks, packets of the console, or
ticks since the pedal went down. A clock rises by at most one per tick. It is 0 in tick 0, except
that the count of packets is 1. Pedal time starts at 0 whenever the pedal goes down.

A window opens when its clock reaches `start`. From then on, take the reading minus `start`, modulo
`every` if `every` is not 0. The window is open while this number is less than `duration` (see
`window`). The functions use NumPy and do not depend on the robot.
"""

from typing import NamedTuple, Protocol

import numpy as np

NEVER = 2**62
"""Replaces a reading or a tick that never occurs."""


class Opening(NamedTuple):
    """The windows of some faults on the clocks of their triggers; each field is int64 [faults]."""

    start: np.ndarray
    duration: np.ndarray
    every: np.ndarray  # 0: the window opens once

    def first(self, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
        """Return the smallest reading from `low` to `high` with an open window, or NEVER."""
        reading = np.maximum(low, self.start)
        repeats = self.every > 0
        beyond = (reading - self.start) % np.where(repeats, self.every, NEVER)
        later = np.where(repeats, reading + self.every - beyond, NEVER)
        reading = np.where(beyond < self.duration, reading, later)
        return np.where(reading <= high, reading, NEVER)

    def last(self, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
        """Return the largest reading from `low` to `high` with an open window, or -1."""
        beyond = (high - self.start) % np.where(self.every > 0, self.every, NEVER)
        reading = high - np.maximum(beyond - self.duration + 1, 0)
        return np.where(reading >= np.maximum(low, self.start), reading, -1)


class Arrivals(Protocol):
    """Times at which packets arrive."""

    def comes(self, rows: np.ndarray, packets: np.ndarray) -> np.ndarray:
        """Return the ticks (int64) in which these packets, counted from 1, arrive in these runs.

        For a packet after the end of the run, the result is any later tick.
        """
        ...

    def newest(self, rows: np.ndarray) -> np.ndarray:
        """Return the number of the newest packet in the last tick of each of these runs, int64."""
        ...


class PedalPhases(NamedTuple):
    """Times at which the pedal is down in a run, unless a check stops the robot."""

    begins: np.ndarray  # int64 [phases], ticks in which the pedal clock is 0, ascending
    ends: np.ndarray  # int64 [phases], first tick after each phase, or the end of the run
    later: int | None = 0  # number of ticks by which these times may be delayed; None: unknown

    def end(self, opening: Opening, ticks: int) -> np.ndarray:
        """Return the first tick after the last window of each fault; 0 if no window opens."""
        after = np.zeros(len(opening.start), np.int64)
        if self.later is None:
            return np.full_like(after, ticks)
        for begin, end in zip(self.begins.tolist(), self.ends.tolist(), strict=True):
            latest = min(end + self.later, ticks)
            reading = opening.last(0, latest - begin - 1)
            tick = np.minimum(begin + self.later + reading + 1, latest)
            after = np.where(reading >= 0, np.maximum(after, tick), after)
        return after


class Clocks(NamedTuple):
    """The packet and pedal clocks of the runs of a campaign."""

    arrivals: Arrivals | None  # None: a fault may stop the packets
    phases: tuple[PedalPhases, ...]
    kind: np.ndarray  # int [runs], index in `phases`
    # bool [channels], by code: True if faults on the channel may change the pedal, other than by
    # stopping the robot
    moved: np.ndarray

    def first_down(self, ticks: int) -> np.ndarray:
        """Return the first tick with the pedal down in each run; `ticks` if there is none."""
        return np.array([min((*phases.begins, ticks)) for phases in self.phases])[self.kind]

    def packet_end(self, rows: np.ndarray, opening: Opening, ticks: int) -> np.ndarray:
        """Return the first tick after the last window on the packet clock; 0: no window opens."""
        if self.arrivals is None:
            return np.full(len(rows), ticks, np.int64)
        repeats = opening.every > 0
        newest = np.full(len(rows), ticks, np.int64)  # no packet number is higher
        if repeats.any():
            newest[repeats] = self.arrivals.newest(rows[repeats])
        last = opening.last(1, newest)
        # after the run's end if there is no such packet
        first = np.minimum(opening.first(1, newest), newest + 1)
        opens = (last > 0) & (self.arrivals.comes(rows, first) < ticks)
        return np.where(
            opens, np.minimum(self.arrivals.comes(rows, np.maximum(last, 0) + 1), ticks), 0
        )

    def pedal_end(self, rows: np.ndarray, opening: Opening, ticks: int) -> np.ndarray:
        """Return the first tick after the last window on the pedal clock; 0: no window opens.

        The result is valid for runs in which no fault changes the pedal.
        """
        after = np.zeros(len(rows), np.int64)
        for kind, phases in enumerate(self.phases):
            mine = self.kind[rows] == kind
            after[mine] = phases.end(Opening(*(column[mine] for column in opening)), ticks)
        return after
