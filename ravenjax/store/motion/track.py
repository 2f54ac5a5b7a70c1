"""The content of a recording before any conversion, and checks that its units are plausible."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}

NEAREST_M, FARTHEST_M = 0.005, 0.5
"""Plausible distances of a tip from the remote centre.

The wrist alone is 13 mm long, and the insertion ends at 0.25 m. A recording that lies outside as a
whole has another unit or another frame.
"""

WIDEST_RAD = math.radians(245.0)
"""Largest opening of the jaws, because each turns by 120 degrees at most."""


@dataclasses.dataclass(frozen=True, eq=False)
class ArmTrack:
    """One arm's samples. A file may have fewer rows for one arm than for the other."""

    # [T] s, on a clock that both arms share; None if the file has no times.
    time_s: np.ndarray | None
    position: np.ndarray  # [T, 3] m, tip in frame 0
    quat: np.ndarray | None  # [T, 4] x, y, z, w, tip in frame 0
    opening_mrad: np.ndarray | None  # [T] positive opens

    def __len__(self) -> int:
        return len(self.position)


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """A whole recording."""

    path: Path
    clock: str  # source of its times, "" if it has none
    arms: dict[str, ArmTrack]
    surgeon_mode: np.ndarray | None  # [T] 0 or 1, at the times of the first arm
    read: tuple[str, ...]  # columns or topics
    ignored: tuple[str, ...]  # the others
    notes: tuple[str, ...] = ()  # further notes


def unit_quaternions(path: Path, arm: str, quat: np.ndarray) -> np.ndarray | None:
    """Return quaternions [T, 4] normalised to length 1.

    Returns None if all are zero, as a trace without rotations writes them.
    """
    length = np.linalg.norm(quat, axis=1)
    if (length == 0.0).all():
        return None
    if (bad := np.flatnonzero(np.abs(length - 1.0) > 1e-2)).size:
        raise UserError(
            f"{path}: row {bad[0]}: quaternion {arm}_qx.. has length {length[bad[0]]:.4g}, expected"
            " 1 (x, y, z, w)"
        )
    return quat / length[:, None]


def check_plausible(track: Track) -> None:
    """Raise UserError for positions that are not those of a tip in frame 0, and for jaws that open
    too wide.
    """
    for arm, samples in track.arms.items():
        distance = np.linalg.norm(samples.position, axis=1)
        if distance.max() < NEAREST_M or distance.min() > FARTHEST_M:
            raise UserError(
                f"{track.path}: the tip of {arm} would be {distance.min() * 1e3:.3g} to"
                f" {distance.max() * 1e3:.3g} mm from the remote centre, the origin of frame 0;"
                f" expected {NEAREST_M * 1e3:g} to {FARTHEST_M * 1e3:g} mm. Write positions in"
                f" frame 0, in the unit of the column's name: {arm}_x_m, {arm}_x_mm or {arm}_x_um"
            )
        opening = samples.opening_mrad
        if opening is not None and (wide := np.abs(opening) > WIDEST_RAD * 1e3).any():
            row = int(np.argmax(wide))
            raise UserError(
                f"{track.path}: row {row}: the jaws of {arm} would open by {opening[row] / 1e3:.4g}"
                f" rad; expected at most {WIDEST_RAD:.3g}. Write the unit into the column's name:"
                f" {arm}_grasp_rad, {arm}_grasp_mrad or {arm}_grasp_deg"
            )
