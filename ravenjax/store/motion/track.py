"""Stores the content of a recording before any conversion, and checks its units."""

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

The wrist alone is 13 mm long, and the insertion ends at 0.25 m. If all positions of a recording lie
outside this range, it uses another unit or another frame.
"""


class Home(NamedTuple):
    """Start pose of a tip, in frame 0."""

    position: np.ndarray  # [3] m
    quat: np.ndarray  # [4] x, y, z, w
    opening_mrad: float


WIDEST_RAD = math.radians(245.0)
"""Largest plausible opening of the jaws: each turns by 120 degrees at most, with a tolerance."""


@dataclasses.dataclass(frozen=True, eq=False)
class ArmTrack:
    """One arm's samples. A file may have fewer rows for one arm than for the other."""

    # [T] s, on the same clock for both arms; None if the file has no times.
    time_s: np.ndarray | None
    position: np.ndarray  # [T, 3] m, position of the tip
    quat: np.ndarray | None  # [T, 4] x, y, z, w, orientation of the tip
    opening_mrad: np.ndarray | None  # [T] opening of the jaws
    frame: Frame = "frame0"  # frame of position and quat as recorded, which `in_frame0` converts

    def __len__(self) -> int:
        return len(self.position)


class Track(NamedTuple):
    """All samples of a recording."""

    path: Path
    clock: str  # name of the column or clock that the times come from; "" if there are no times
    arms: dict[str, ArmTrack]
    surgeon_mode: np.ndarray | None  # [T] pedal, 0 up or 1 down, at the times of the first arm
    read: tuple[str, ...]  # columns or topics that were used
    ignored: tuple[str, ...]  # columns or topics that were not used
    notes: tuple[str, ...] = ()  # remarks on how the file was read


def in_frame0(
    samples: ArmTrack, arm: ArmName, options: ReplayOptions, first: int, home: Home
) -> ArmTrack:
    """Return samples converted to frame 0 of their arm, as the options request. first: index of the
    sample that option place = "home" puts at the pose after homing.
    """
    from scipy.spatial.transform import Rotation

    from ravenjax.robots.raven2.geometry.mapping import ITP_AXES

    # The columns of `axes` are the axes of a console in frame 0. CRTK's base frame has the same x
    # axis, and opposite y and z axes. Source: raven2 `src/raven/crtk_motion_api.cpp`.
    axes = np.array(ITP_AXES[arm])
    frames = {"frame0": np.eye(3), "console": axes, "arm_base": axes * [1.0, -1.0, -1.0]}
    given = of_arm(options.rotation, arm)
    if given is None:
        turn = Rotation.identity()
    elif len(given) == 4:
        turn = Rotation.from_quat(given)
    else:
        turn = Rotation.from_matrix(np.array(given))
    turn = turn * Rotation.from_matrix(frames[options.frame or samples.frame])
    position = turn.apply(samples.position)
    position += np.array(of_arm(options.offset_mm, arm) or (0.0, 0.0, 0.0)) * 1e-3
    quat = None
    if samples.quat is not None:
        turned = turn * Rotation.from_quat(samples.quat)
        if options.place == "home":
            # The axes fixed to the recorded instrument may differ from those of the Raven-II.
            turned = turned * (turned[first].inv() * Rotation.from_quat(home.quat))
        quat = turned.as_quat()
    if options.place == "home":
        position += home.position - position[first]
    return dataclasses.replace(samples, position=position, quat=quat)


def check_plausible(track: Track) -> None:
    """Raise UserError if positions are implausible in frame 0, or if jaws open too wide."""
    for arm, samples in track.arms.items():
        distance = np.linalg.norm(samples.position, axis=1)
        # With operator.place = "home" some positions are always near.
        if distance.max() < NEAREST_M or np.median(distance) > FARTHEST_M:
            raise UserError(
                f"{track.path}: the tip of {arm} would be {distance.min() * 1e3:.3g} to"
                f" {distance.max() * 1e3:.3g} mm from the remote centre, the origin of frame 0;"
                f" expected {NEAREST_M * 1e3:g} to {FARTHEST_M * 1e3:g} mm. Write positions in"
                f" the unit of the column's name: {arm}_x_m, {arm}_x_mm or {arm}_x_um; in a bag,"
                ' in m. If they are of another frame, write operator.place = "home", or'
                " operator.rotation and operator.offset_mm"
            )
        opening = samples.opening_mrad
        if opening is not None and (wide := np.abs(opening) > WIDEST_RAD * 1e3).any():
            row = int(np.argmax(wide))
            raise UserError(
                f"{track.path}: row {row}: the jaws of {arm} would open by {opening[row] / 1e3:.4g}"
                f" rad; expected at most {WIDEST_RAD:.3g}. Write the unit into the column's name:"
                f" {arm}_grasp_rad, {arm}_grasp_mrad or {arm}_grasp_deg"
            )
