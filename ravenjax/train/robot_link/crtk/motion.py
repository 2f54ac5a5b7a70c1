"""Turns the motion that CRTK requests of an arm into increments for its control software.

The software accepts only increments: whole micrometres, turns, milliradians of the jaws. It adds
them up. The follower keeps the same sum, starting from the software's setpoint at pedal-down, and
sends the missing part within the limits below. The software clamps at joint limits. If its setpoint
differs once all increments have arrived, the follower adopts that setpoint and drops its target.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ravenjax.train.protocol import Json
from ravenjax.train.robot import ITP_AXES, ArmName, tip_pose
from ravenjax.train.robot_link.packet_filter import STILL

SPEED_UM_MS = 200.0
"""0.2 m/s; recorded teleoperation stays below 232 um per ms."""
TURN_RAD_MS = 4e-3
GRASP_MRAD_MS = 4.0
FARTHEST_UM = 75_000.0
"""A pose farther than this from the arm's setpoint is refused, as in raven2's CRTK."""
SLIP_UM, SLIP_RAD = 20.0, 2e-3
"""Differences that rounding cannot explain."""
SETTLED_TICKS = 30
"""Ticks of the software after which it has reached its setpoint."""

BASE: dict[ArmName, np.ndarray] = {
    "gold": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "green": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""CRTK's base frame of an arm: a point p of frame 0 is BASE p there, a rotation R is BASE R.

Source: raven2 `src/raven/crtk_motion_api.cpp`; `params/raven_*_crtk.yaml` give poses to check with.
"""
FASTEST = np.array([*np.radians([5, 5]), 0.02, *np.radians([15, 15, 15, 15])])
"""rad/s, insertion m/s: the limits of the Raven's public CRTK clients."""
STRONGEST = np.array([1.0, 1.0, 0.1, 1.0, 1.0, 1.0, 1.0])
"""rad/s^2, A_MAX of raven2's `defines.h`; insertion m/s^2, assumed."""
_PEAK_SPEED, _PEAK_ACCELERATION = 1.875, 10 / math.sqrt(3)
"""Peaks of the minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5 over its time."""


def to_base(arm: ArmName, position: np.ndarray, rotation: np.ndarray) -> tuple[Any, Any]:
    """Return CRTK's position, m, and quaternion of a pose in frame 0."""
    quat = Rotation.from_matrix(BASE[arm] @ rotation).as_quat(canonical=True)
    return (BASE[arm] @ position).tolist(), quat.tolist()


def from_base(
    arm: ArmName, position: np.ndarray, quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position, m, and rotation in frame 0 of CRTK's pose."""
    return BASE[arm].T @ position, BASE[arm].T @ Rotation.from_quat(quat).as_matrix()


class Setpoint(NamedTuple):
    """A setpoint of an arm in frame 0."""

    position_um: np.ndarray  # [3]
    rotation: Rotation
    grasp_mrad: float  # jaw opening

    @staticmethod
    def of(position_m: np.ndarray, rotation: np.ndarray, grasp_rad: float) -> Setpoint:
        """Return the setpoint of a position, m, a rotation, and the jaws' opening."""
        return Setpoint(
            np.asarray(position_m) * 1e6, Rotation.from_matrix(rotation), grasp_rad * 1e3
        )

    @staticmethod
    def at(arm: ArmName, jpos: np.ndarray) -> Setpoint:
        """Return the setpoint at joints [7], rad and m."""
        return Setpoint.of(*tip_pose(arm, jpos), float(jpos[5] + jpos[6]))


class SetpointFollower:
    """Computes the increments of one arm."""

    def __init__(self, arm: ArmName, grasp_gain: int = 1) -> None:
        """grasp_gain: mrad that the jaws close per mrad of an increment in the control software."""
        self._gain = grasp_gain
        self._axes = np.array(ITP_AXES[arm], float)
        self.sum: Setpoint | None = None  # None: the arm does not drive
        self.target: Setpoint | None = None

    def engage(self, at: Setpoint) -> None:
        """Start at the software's setpoint, because the pedal is down."""
        self.sum = Setpoint(np.rint(at.position_um), at.rotation, round(at.grasp_mrad))
        self.target = None

    def release(self) -> None:
        """Stop, because the pedal is up."""
        self.sum = self.target = None

    def aim(self, target: Setpoint) -> bool:
        """Set the target. Return False if it is too far away, or the pedal is up."""
        if self.sum is None:
            return False
        if np.linalg.norm(target.position_um - self.sum.position_um) > FARTHEST_UM:
            return False
        self.target = target
        return True

    def has_slipped(self, at: Setpoint) -> bool:
        """Whether the software's setpoint is not the one sent. The follower then adopts it."""
        if self.sum is None:
            return False
        slipped = (
            np.abs(at.position_um - self.sum.position_um).max() > SLIP_UM
            or (at.rotation * self.sum.rotation.inv()).magnitude() > SLIP_RAD
            or abs(at.grasp_mrad - self.sum.grasp_mrad) * 1e-3 > SLIP_RAD
        )
        if slipped:
            self.engage(at)
        return bool(slipped)

    def step(self, elapsed_ms: float) -> Json:
        """Return the increment to send now, ITP frame, as in a command "increments"."""
        if self.sum is None or self.target is None:
            return STILL
        position, rotation, grasp = self.sum
        missing = self.target.position_um - position
        far = float(np.linalg.norm(missing)) / (SPEED_UM_MS * elapsed_ms or 1e-9)
        delta = np.rint(missing / max(1.0, far))
        turn = (self.target.rotation * rotation.inv()).as_rotvec()
        angle = float(np.linalg.norm(turn))
        turn *= 0.0 if angle < 1e-6 else min(1.0, TURN_RAD_MS * elapsed_ms / angle)
        most = GRASP_MRAD_MS * elapsed_ms
        steps = round(min(max(self.target.grasp_mrad - grasp, -most), most) / self._gain)
        if not delta.any() and not turn.any() and not steps:
            return STILL
        turned = Rotation.from_rotvec(turn) * rotation
        self.sum = Setpoint(position + delta, turned, grasp + self._gain * steps)
        return {
            "delta_um": [int(n) for n in np.rint(self._axes.T @ delta)],
            "quat": Rotation.from_rotvec(self._axes.T @ turn).as_quat().tolist(),
            "grasp_mrad": -steps,
        }


class Trajectory:
    """`move_jp`: minimum-jerk motion between joint positions within the limits of each joint."""

    def __init__(self, start: np.ndarray, goal: np.ndarray, begins_ms: float) -> None:
        """start, goal: [7], rad, insertion m."""
        self._start, self._way, self._begins_ms = start, goal - start, begins_ms
        way = np.abs(self._way)
        by_speed, by_acceleration = way / FASTEST, np.sqrt(_PEAK_ACCELERATION * way / STRONGEST)
        self.seconds = float(max((_PEAK_SPEED * by_speed).max(), by_acceleration.max()))

    def at(self, now_ms: float) -> tuple[np.ndarray, bool]:
        """Return the joints at this time, and whether the goal is reached."""
        passed_s = (now_ms - self._begins_ms) * 1e-3
        s = 1.0 if passed_s >= self.seconds else max(passed_s / self.seconds, 0.0)
        return self._start + s**3 * (10 + s * (6 * s - 15)) * self._way, s == 1.0
