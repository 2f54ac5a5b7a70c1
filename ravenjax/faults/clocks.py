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
        since_opening = (reading - self.start) % np.where(repeats, self.every, NEVER)
        next_opening = np.where(repeats, reading + self.every - since_opening, NEVER)
        reading = np.where(since_opening < self.duration, reading, next_opening)
        return np.where(reading <= high, reading, NEVER)

    def last(self, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
        """Return the largest reading from `low` to `high` with an open window, or -1."""
        since_opening = (high - self.start) % np.where(self.every > 0, self.every, NEVER)
        # This is the last reading of the window if it has shut before `high`, else `high`.
        reading = high - np.maximum(since_opening - self.duration + 1, 0)
        return np.where(reading >= np.maximum(low, self.start), reading, -1)


class Arrivals(Protocol):
    """Times at which packets arrive."""

    def arrival_ticks(self, rows: np.ndarray, packets: np.ndarray) -> np.ndarray:
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
        """Return the first tick after each fault's last window on the pedal clock; 0: no window."""
        window_end = np.zeros(len(opening.start), np.int64)
        if self.later is None:
            return np.full_like(window_end, ticks)
        for begin, end in zip(self.begins.tolist(), self.ends.tolist(), strict=True):
            # The phase may begin and end up to `later` ticks late. It is longest, and its clock
            # rises highest, if it begins on time and ends late. The first reading is 0.
            latest_end = min(end + self.later, ticks)
            # The largest reading with an open window; -1: none. The clock shows it latest if the
            # phase begins late. The window shuts in the next tick, or when the phase ends.
            last_open = opening.last(0, latest_end - begin - 1)
            shut_tick = np.minimum(begin + self.later + last_open + 1, latest_end)
            window_end = np.where(last_open >= 0, np.maximum(window_end, shut_tick), window_end)
        return window_end


class Clocks(NamedTuple):
    """The packet and pedal clocks of the runs of a campaign."""

    arrivals: Arrivals | None  # None: a fault may stop the packets
    phases: tuple[PedalPhases, ...]
    kind: np.ndarray  # int [runs], index in `phases`
    # bool [channels], by code: True if faults on the channel may change the pedal, other than by
    # stopping the robot.
    moved: np.ndarray

    def first_down(self, ticks: int) -> np.ndarray:
        """Return each run's first tick with the pedal down; without one, its length `ticks`."""
        first_of_kind = np.array([min((*phases.begins, ticks)) for phases in self.phases])
        return first_of_kind[self.kind]

    def packet_end(self, rows: np.ndarray, opening: Opening, ticks: int) -> np.ndarray:
        """Return the first tick after each fault's last window on the packet clock; 0: none opens.
        rows: runs of the faults. opening: their windows. ticks: length of a run.
        """
        if self.arrivals is None:
            return np.full(len(rows), ticks, np.int64)
        repeats = opening.every > 0
        # No packet number is above `ticks`: they count from 1, at most one per tick. Only windows
        # that repeat need the number of the run's last packet.
        newest = np.full(len(rows), ticks, np.int64)
        if repeats.any():
            newest[repeats] = self.arrivals.newest(rows[repeats])
        # The last and the first packet with an open window; without one, -1 and `newest` + 1.
        last_packet = opening.last(1, newest)
        first_packet = np.minimum(opening.first(1, newest), newest + 1)
        opens = (last_packet > 0) & (self.arrivals.arrival_ticks(rows, first_packet) < ticks)
        # The window shuts when the packet after the last one arrives.
        shut_tick = self.arrivals.arrival_ticks(rows, np.maximum(last_packet, 0) + 1)
        return np.where(opens, np.minimum(shut_tick, ticks), 0)

    def pedal_end(self, rows: np.ndarray, opening: Opening, ticks: int) -> np.ndarray:
        """Return the first tick after each fault's last window on the pedal clock; 0: none opens.
        rows: runs of the faults. opening: their windows. ticks: length of a run. Valid only for
        runs in which no fault changes the pedal.
        """
        window_end = np.zeros(len(rows), np.int64)
        # Runs of the same kind have the same times of pedal-down.
        for kind, phases in enumerate(self.phases):
            of_kind = self.kind[rows] == kind
            kind_opening = Opening(*(column[of_kind] for column in opening))
            window_end[of_kind] = phases.end(kind_opening, ticks)
        return window_end
