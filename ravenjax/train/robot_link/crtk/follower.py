"""From poses that an arm is to take to the increments that its control software takes, which knows
nothing else.

The software adds up increments: whole micrometres, turns, milliradians of the jaws. The follower
keeps the same sum, from where the software stood when the pedal went down, and sends what is
missing, no faster than `DriveLimits`. Where the software stands elsewhere once all has arrived (it
clamps at joint limits, and lets its console slip), the follower takes that over and drops its
target.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ravenjax.numbers.lazy import at_once
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES, quat_from_matrix, quat_mul
from ravenjax.train.session.hands import unit

Quat = tuple[float, float, float, float]
LEVEL: Quat = (0.0, 0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class DriveLimits:
    """How an arm may be driven."""

    speed_um_ms: float = 200.0  # 0.2 m/s; recorded teleoperation stays below 232 um per ms
    turn_rad_ms: float = 4e-3
    grasp_mrad_ms: float = 4.0
    farthest_m: float = (
        0.075  # a pose farther from where the arm is wanted now is refused, as raven2's CRTK does
    )
    slip_um: float = 20.0  # what rounding cannot explain
    slip_rad: float = 2e-3


SETTLED_TICKS = 30
"""Of the software, after which it stands where it was sent."""


class Setpoint(NamedTuple):
    """Where an arm is wanted, frame 0."""

    position_um: np.ndarray  # [3]
    quat: Quat
    grasp_mrad: float  # jaw opening


class ArmIncrement(NamedTuple):
    """What is sent: axes of the ITP frame."""

    delta_um: tuple[int, int, int]
    quat: Quat
    grasp_mrad: int  # positive closes


STILL = ArmIncrement((0, 0, 0), LEVEL, 0)


class SetpointFollower:
    """Of one arm."""

    def __init__(
        self, arm: ArmName, grasp_gain: int = 1, limits: DriveLimits | None = None
    ) -> None:
        """grasp_gain: mrad that the jaws close per mrad of an increment, the software's."""
        self._gain = grasp_gain
        self._axes = np.array(ITP_AXES[arm], float)
        self._limits = limits or DriveLimits()
        self.sum: Setpoint | None = None  # None: the arm does not drive
        self.target: Setpoint | None = None
        self.slips = 0

    def engage(self, at: Setpoint) -> None:
        """The pedal is down, the software stands at `at`."""
        self.sum = Setpoint(np.rint(at.position_um), at.quat, round(at.grasp_mrad))
        self.target = None

    def release(self) -> None:
        """The pedal is up."""
        self.sum = self.target = None

    def aim(self, target: Setpoint) -> bool:
        """Go there; False where that is too far at once, or the pedal is up."""
        if self.sum is None:
            return False
        if (
            np.linalg.norm(target.position_um - self.sum.position_um)
            > self._limits.farthest_m * 1e6
        ):
            return False
        self.target = target
        return True

    def compare(self, at: Setpoint) -> None:
        """Where the software stands, told after all that was sent has arrived."""
        if self.sum is None:
            return
        off = np.abs(at.position_um - self.sum.position_um).max()
        turned = _angle(_between(self.sum.quat, at.quat))
        jaws = abs(at.grasp_mrad - self.sum.grasp_mrad) * 1e-3
        if (
            off > self._limits.slip_um
            or turned > self._limits.slip_rad
            or jaws > self._limits.slip_rad
        ):
            self.slips += 1
            self.engage(at)

    def step(self, elapsed_ms: float) -> ArmIncrement:
        """What to send now, of what is missing."""
        if self.sum is None or self.target is None:
            return STILL
        limits, (position, quat, grasp) = self._limits, self.sum
        missing = self.target.position_um - position
        length = float(np.linalg.norm(missing))
        most = limits.speed_um_ms * elapsed_ms
        delta = np.rint(missing if length <= most else missing * (most / length))
        turn = _between(quat, self.target.quat)
        angle = _angle(turn)
        turn = (
            LEVEL
            if angle < 1e-6
            else _share(turn, min(1.0, limits.turn_rad_ms * elapsed_ms / angle))
        )
        most = limits.grasp_mrad_ms * elapsed_ms
        steps = round(min(max(self.target.grasp_mrad - grasp, -most), most) / self._gain)
        if not delta.any() and turn == LEVEL and not steps:
            return STILL
        with at_once():
            quat = unit(quat_mul(Vec(turn), Vec(quat)))
        self.sum = Setpoint(position + delta, quat, grasp + self._gain * steps)
        x, y, z = (int(n) for n in np.rint(self._axes.T @ delta))
        qx, qy, qz = (self._axes.T @ np.array(turn[:3])).tolist()
        return ArmIncrement((x, y, z), (qx, qy, qz, turn[3]), -steps)


def setpoint(position_m: np.ndarray, rotation: np.ndarray, grasp_rad: float) -> Setpoint:
    """Of a pose in frame 0, m, and the jaws' opening."""
    with at_once():
        x, y, z, w = map(
            float, quat_from_matrix(Vec(Vec(row) for row in np.asarray(rotation).tolist()))
        )
    return Setpoint(np.asarray(position_m) * 1e6, unit((x, y, z, w)), grasp_rad * 1e3)


def _between(first: Quat, then: Quat) -> Quat:
    """The turn that leads from one to the other, the short way."""
    x, y, z, w = first
    with at_once():
        turn = unit(tuple(map(float, quat_mul(Vec(then), Vec((-x, -y, -z, w))))))
    return turn if turn[3] >= 0 else (-turn[0], -turn[1], -turn[2], -turn[3])


def _angle(turn: Quat) -> float:
    return 2 * math.atan2(math.hypot(*turn[:3]), turn[3])


def _share(turn: Quat, share: float) -> Quat:
    """So much of a turn."""
    if share == 1.0:
        return turn
    half = 0.5 * share * _angle(turn)
    scale = math.sin(half) / math.hypot(*turn[:3])
    return turn[0] * scale, turn[1] * scale, turn[2] * scale, math.cos(half)
