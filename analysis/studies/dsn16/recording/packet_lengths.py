"""How many control cycles a packet of the console lasts, from recordings; see
`ravenjax.vocabulary.packets`.
"""

from __future__ import annotations

import numpy as np

from ravenjax.robots.raven2.geometry import transmission
from studies.dsn16.recording.closed_loop import KP, JointRecording

RAD_PER_COUNT = 1.0 / (np.array(transmission.COUNTS_PER_NM[:3]) * KP)
"""Motor angle that one DAC count stands for: what truncation leaves uncertain of
`JointRecording.asked`.
"""

SAME_COUNTS = 1.02
"""Two truncated numbers differ by less than one count where what they are of is the same; a
little for printing.
"""

HALF_WINDOW = 10
"""Rows on each side over which the speed is averaged that tells a hand at rest from a packet
that repeats.
"""


def of_robot(recording: JointRecording, counts_per_ms: float = 5.0) -> np.ndarray:
    """Cycles that each desired position stands while the arm moves, int [packets].

    counts_per_ms: the fastest motor moves by so many RAD_PER_COUNT, so that a step of the hand
    shows in the DAC.
    """
    change = np.diff(recording.asked, axis=0) / RAD_PER_COUNT
    repeats = np.all(np.abs(change) <= SAME_COUNTS, axis=1)
    far = np.abs(recording.angle[2 * HALF_WINDOW :] - recording.angle[: -2 * HALF_WINDOW])
    fast = (far / (2 * HALF_WINDOW * RAD_PER_COUNT)).max(axis=1) > counts_per_ms
    return run_lengths(repeats, np.pad(fast, HALF_WINDOW))


def of_positions(position: np.ndarray, um_per_ms: float = 10.0) -> np.ndarray:
    """The same of desired positions at 1 kHz (um, [T, 3]) while the hand moves faster than
    `um_per_ms`.
    """
    repeats = np.all(np.diff(position, axis=0) == 0, axis=1)
    far = np.linalg.norm(position[2 * HALF_WINDOW :] - position[: -2 * HALF_WINDOW], axis=1)
    return run_lengths(repeats, np.pad(far / (2 * HALF_WINDOW) > um_per_ms, HALF_WINDOW))


def run_lengths(repeats: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Rows from a change to the next, int, of the runs in which every row is `moving` (bool [T]).

    repeats: bool [T - 1], row i + 1 is as row i.
    """
    first = np.flatnonzero(~repeats) + 1
    at_rest = np.concatenate([[0], np.cumsum(~moving)])
    resting_rows = at_rest[first[1:]] - at_rest[first[:-1]]
    return np.diff(first)[resting_rows == 0]
