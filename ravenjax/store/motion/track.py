"""What a recording holds, before anything is done to it, and whether its numbers can be what their
units say.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}

NEAREST_M, FARTHEST_M = 0.005, 0.5
"""A tip stays farther than the one from the remote centre (the wrist alone is 13 mm long) and
nearer than the other (the insertion ends at 0.25 m): a whole recording outside has another unit, or
another frame."""

WIDEST_RAD = math.radians(245.0)
"""Jaws cannot open wider: each turns by 120 degrees at most."""


@dataclasses.dataclass(frozen=True, eq=False)
class ArmTrack:
    """One arm's samples; rows of a file may be fewer for one arm than for the other."""

    time_s: (
        np.ndarray | None
    )  # [T] s, on a clock that both arms share; None where the file has no times
    position: np.ndarray  # [T, 3] m, tip in frame 0
    quat: np.ndarray | None  # [T, 4] x, y, z, w, tip in frame 0
    opening_mrad: np.ndarray | None  # [T] positive opens

    def __len__(self) -> int:
        return len(self.position)


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """A whole recording."""

    path: Path
    clock: str  # where its times come from, "" where it has none
    arms: dict[str, ArmTrack]
    surgeon_mode: np.ndarray | None  # [T] 0 or 1, at the times of the first arm
    read: tuple[str, ...]  # columns or topics
    ignored: tuple[str, ...]  # the others
    notes: tuple[str, ...] = ()  # what else a reader should know


def unit_quaternions(path: Path, arm: str, quat: np.ndarray) -> np.ndarray | None:
    """Quaternions [T, 4] of length 1; None where all are zero, as a trace without rotations
    writes them.
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
    """UserError for positions that are not those of a tip in frame 0, and for jaws that open too
    wide.
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
