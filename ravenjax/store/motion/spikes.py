"""Finds samples at which a recorded tip jumps: where, how far, and whether it returns at once."""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.store.motion.options import Spikes
from ravenjax.store.motion.track import ArmTrack

FASTEST_M_S = 0.5
"""Fastest plausible motion of a tip.

Tips of instruments move at 5 to 60 mm/s in surgery; the fastest of the public recording at 190
mm/s.
"""

LEAST_M = 1e-3
"""Smallest step that counts as a jump, however close its two stamps are."""

MOST_ROWS = 20
"""Largest number of samples of a spike. A tip that stays away longer has moved."""

SHOWN = 5
"""Number of spikes that an error lists."""


class Spike(NamedTuple):
    """Some samples away from the tip's position before and after, or a jump without return."""

    arm: str
    row: int  # first sample that is away
    # Number of samples that are away; 0: the tip does not return.
    rows: int
    time_s: float  # of that sample
    size_mm: float  # largest distance from the sample before
    begin_s: float  # time of the sample before
    end_s: float  # time of the sample after

    @property
    def words(self) -> str:
        """Return row, time and size as text."""
        what = f"{self.size_mm:.3g} mm"
        length = (
            f" for {self.rows} rows"
            if self.rows > 1
            else ""
            if self.rows
            else ", without coming back"
        )
        return f"row {self.row} ({self.time_s:.3f} s, {self.arm}): {what}{length}"


def find_spikes(arm: str, track: ArmTrack, time_s: np.ndarray, max_gap_s: float) -> list[Spike]:
    """Return the jumps of one arm in order; time_s [T]: times of its samples."""
    place = track.position
    length, seconds = np.linalg.norm(np.diff(place, axis=0), axis=1), np.diff(time_s)
    jumps = np.flatnonzero((length > LEAST_M) & (length > FASTEST_M_S * seconds)).tolist()
    spikes: list[Spike] = []
    last = -1
    for step in jumps:
        if step <= last:
            continue
        near = (
            j
            for j in jumps
            if step < j <= step + MOST_ROWS and time_s[j + 1] - time_s[step] <= max_gap_s
        )
        back = next((j for j in near if _returns(place, time_s, step, j)), None)
        last = step if back is None else back
        away = place[step + 1 : max(last, step + 1) + 1]
        size = float(np.linalg.norm(away - place[step], axis=1).max()) * 1e3
        at_s, begin_s, end_s = time_s[[step + 1, step, last + 1]].tolist()
        spikes.append(Spike(arm, step + 1, last - step, at_s, size, begin_s, end_s))
    return spikes


def _returns(place: np.ndarray, time_s: np.ndarray, before: int, after: int) -> bool:
    """Return whether the tip, after step `after`, is where it could be without the jump."""
    way = float(np.linalg.norm(place[after + 1] - place[before]))
    return way <= max(LEAST_M, FASTEST_M_S * float(time_s[after + 1] - time_s[before]))


def remove_spikes(
    track: ArmTrack, time_s: np.ndarray, spikes: list[Spike]
) -> tuple[ArmTrack, np.ndarray]:
    """Return the arm's samples, and their times, without those that are away."""
    stay = np.ones(len(track), bool)
    for spike in spikes:
        stay[spike.row : spike.row + spike.rows] = False
    quat, opening = track.quat, track.opening_mrad
    some = dataclasses.replace(
        track,
        position=track.position[stay],
        quat=None if quat is None else quat[stay],
        opening_mrad=None if opening is None else opening[stay],
    )
    return some, time_s[stay]


def spike_error(path: Path, spikes: list[Spike], treatment: Spikes) -> UserError:
    """Return the error for jumps in the replayed part; treatment: value of the option `spikes`."""
    more = f" and {len(spikes) - SHOWN} more" if len(spikes) > SHOWN else ""
    removal = 'operator.spikes = "remove" interpolates over them; ' if treatment == "refuse" else ""
    if not all(spike.rows for spike in spikes):
        removal = ""
    return UserError(
        f"{path}: the tip jumps at {'; '.join(spike.words for spike in spikes[:SHOWN])}{more}."
        f" Expected no step of more than {LEAST_M * 1e3:g} mm at more than {FASTEST_M_S:g} m/s."
        f' {removal}operator.window_s cuts a part without them; operator.spikes = "replay" plays'
        " them as they are"
    )
