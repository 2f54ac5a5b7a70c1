"""Stores the content of a recording before any conversion, and checks that its units are
plausible."""

import dataclasses
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.store.motion.options import Frame, ReplayOptions, of_arm

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}

NEAREST_M, FARTHEST_M = 0.005, 0.5
"""Plausible distances of a tip from the remote centre.

The wrist alone is 13 mm long, and the insertion ends at 0.25 m. A recording that lies outside as a
whole has another unit or another frame.
"""


class Home(NamedTuple):
    """Pose in which a tip begins, in frame 0."""

    position: np.ndarray  # [3] m
    quat: np.ndarray  # [4] x, y, z, w
    opening_mrad: float


WIDEST_RAD = math.radians(245.0)
"""Largest opening of the jaws, because each turns by 120 degrees at most."""


@dataclasses.dataclass(frozen=True, eq=False)
class ArmTrack:
    """One arm's samples. A file may have fewer rows for one arm than for the other."""

    # [T] s, on a clock that both arms share; None if the file has no times.
    time_s: np.ndarray | None
    position: np.ndarray  # [T, 3] m, tip
    quat: np.ndarray | None  # [T, 4] x, y, z, w, tip
    opening_mrad: np.ndarray | None  # [T] positive opens
    frame: Frame = "frame0"  # in which position and quat are, until `in_frame0`

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


def in_frame0(
    samples: ArmTrack, arm: ArmName, options: ReplayOptions, first: int, home: Home
) -> ArmTrack:
    """Return samples in frame 0 of their arm, as the options place them. first: sample that is put
    at the pose after homing, if one is.
    """
    # Slow to import.
    from scipy.spatial.transform import Rotation

    from ravenjax.robots.raven2.geometry.mapping import ITP_AXES

    # A point p of frame 0 is axes.T @ p about the axes of a console, and CRTK's base frame has
    # these with y and z reversed. Source: raven2 `src/raven/crtk_motion_api.cpp`.
    axes = np.array(ITP_AXES[arm])
    frames = {"frame0": np.eye(3), "console": axes, "arm_base": axes * [1.0, -1.0, -1.0]}
    own = of_arm(options.rotation, arm)
    if own is None:
        turn = Rotation.identity()
    elif len(own) == 4:
        turn = Rotation.from_quat(own)
    else:
        turn = Rotation.from_matrix(np.array(own))
    turn = turn * Rotation.from_matrix(frames[options.frame or samples.frame])
    position = turn.apply(samples.position)
    position += np.array(of_arm(options.offset_mm, arm) or (0.0, 0.0, 0.0)) * 1e-3
    quat = None
    if samples.quat is not None:
        turned = turn * Rotation.from_quat(samples.quat)
        if options.place == "home":
            # The frame of the recorded instrument may be another.
            turned = turned * (turned[first].inv() * Rotation.from_quat(home.quat))
        quat = turned.as_quat()
    if options.place == "home":
        position += home.position - position[first]
    return dataclasses.replace(samples, position=position, quat=quat)


def check_plausible(track: Track) -> None:
    """Raise UserError for positions that no tip in frame 0 has, and for jaws that open too wide."""
    for arm, samples in track.arms.items():
        distance = np.linalg.norm(samples.position, axis=1)
        if distance.max() < NEAREST_M or distance.min() > FARTHEST_M:
            raise UserError(
                f"{track.path}: the tip of {arm} would be {distance.min() * 1e3:.3g} to"
                f" {distance.max() * 1e3:.3g} mm from the remote centre, the origin of frame 0;"
                f" expected {NEAREST_M * 1e3:g} to {FARTHEST_M * 1e3:g} mm. Write positions in"
                f" the unit of the column's name: {arm}_x_m, {arm}_x_mm or {arm}_x_um. If they are"
                ' of another frame, write operator.place = "home", or operator.rotation and'
                " operator.offset_mm"
            )
        opening = samples.opening_mrad
        if opening is not None and (wide := np.abs(opening) > WIDEST_RAD * 1e3).any():
            row = int(np.argmax(wide))
            raise UserError(
                f"{track.path}: row {row}: the jaws of {arm} would open by {opening[row] / 1e3:.4g}"
                f" rad; expected at most {WIDEST_RAD:.3g}. Write the unit into the column's name:"
                f" {arm}_grasp_rad, {arm}_grasp_mrad or {arm}_grasp_deg"
            )
