"""Finds samples at which a recorded tip jumps: where, how far, and whether it returns at once."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.store.motion.options import Spikes
from ravenjax.store.motion.track import ArmTrack

FASTEST_M_S = 0.5
"""Largest plausible speed of a tip.

Instrument tips move at 5 to 60 mm/s in surgery; in the public recording at 190 mm/s at most.
"""

LEAST_M = 1e-3
"""Smallest step that counts as a jump, however close its two time stamps are."""

MOST_ROWS = 20
"""Largest number of samples of a spike. A tip that stays away for longer has really moved."""

SHOWN = 5
"""Largest number of spikes that an error message lists."""


class Spike(NamedTuple):
    """A jump of a tip, and the samples until the tip jumps back, if it does."""

    arm: str
    row: int  # first sample after the jump
    rows: int  # number of samples until the tip jumps back; 0: it does not
    time_s: float  # time of the first sample after the jump
    size_mm: float  # largest distance from the sample before the jump
    begin_s: float  # time of the sample before the jump
    end_s: float  # time of the first sample after the spike

    @property
    def words(self) -> str:
        """Return row, time and size as text."""
        length = f" for {self.rows} rows" if self.rows > 1 else ""
        if not self.rows:
            length = ", without jumping back"
        place = f"row {self.row} ({self.time_s:.3f} s, {self.arm})"
        return f"{place}: {self.size_mm:.3g} mm{length}"


def find_spikes(arm: str, track: ArmTrack, time_s: np.ndarray, max_gap_s: float) -> list[Spike]:
    """Return the implausible jumps of one arm's tip in order. time_s [T]: times of its samples. A
    jump away and the jump back to a plausible place are one `Spike`.
    """
    tip = track.position
    length, seconds = np.linalg.norm(np.diff(tip, axis=0), axis=1), np.diff(time_s)
    # Each jump is the index of the sample before it.
    jumps = np.flatnonzero((length > LEAST_M) & (length > FASTEST_M_S * seconds)).tolist()
    spikes: list[Spike] = []
    last = -1
    for before in jumps:
        # This jump belongs to the spike before.
        if before <= last:
            continue
        next_jumps = (
            j
            for j in jumps
            if before < j <= before + MOST_ROWS and time_s[j + 1] - time_s[before] <= max_gap_s
        )
        # The last sample of the spike; `before` if the tip does not jump back.
        last = next((j for j in next_jumps if _can_move(tip, time_s, before, j + 1)), before)
        first = before + 1
        away = tip[first : max(last, first) + 1]
        size = float(np.linalg.norm(away - tip[before], axis=1).max()) * 1e3
        at_s, begin_s, end_s = time_s[[first, before, last + 1]].tolist()
        spikes.append(Spike(arm, first, last - before, at_s, size, begin_s, end_s))
    return spikes


def _can_move(tip: np.ndarray, time_s: np.ndarray, first: int, second: int) -> bool:
    # Returns whether a plausible motion leads from sample `first` to `second`. tip: [T, 3], m.
    distance = float(np.linalg.norm(tip[second] - tip[first]))
    return distance <= max(LEAST_M, FASTEST_M_S * float(time_s[second] - time_s[first]))


def remove_spikes(
    track: ArmTrack, time_s: np.ndarray, spikes: list[Spike]
) -> tuple[ArmTrack, np.ndarray]:
    """Return the arm's samples, and their times, without the samples of spikes."""
    stay = np.ones(len(track), bool)
    for spike in spikes:
        stay[spike.row : spike.row + spike.rows] = False
    arrays = {name: x[stay] for name, x in vars(track).items() if isinstance(x, np.ndarray)}
    return dataclasses.replace(track, **arrays), time_s[stay]


def refused_jumps(jumps: Sequence[Spike], treatment: Spikes) -> list[Spike]:
    """Return the jumps that must not be replayed; treatment: value of the option `spikes`."""
    if treatment == "replay":
        return []
    return [spike for spike in jumps if treatment == "refuse" or not spike.rows]


def spike_error(path: Path, spikes: list[Spike], treatment: Spikes) -> UserError:
    """Return the error for jumps in the replayed part; treatment: value of the option `spikes`."""
    more = f" and {len(spikes) - SHOWN} more" if len(spikes) > SHOWN else ""
    removal = ""
    # A jump without a jump back has rows = 0 and cannot be removed.
    if treatment == "refuse" and all(spike.rows for spike in spikes):
        removal = 'operator.spikes = "remove" interpolates over them; '
    return UserError(
        f"{path}: the tip jumps at {'; '.join(spike.words for spike in spikes[:SHOWN])}{more}."
        f" Expected no step of more than {LEAST_M * 1e3:g} mm at more than {FASTEST_M_S:g} m/s."
        f' {removal}operator.window_s selects a part without jumps; operator.spikes = "replay"'
        " replays the jumps unchanged"
    )
