"""Converts the messages of consoles into the motion of the operator's hands, one row for each tick.

Speeds of "input" messages are along the axes of the view. The hands change their speed smoothly:
critically damped, with 90 % of the change after `SMOOTHING_MS`. Positions are in the ITP frame of
the arm, in micrometres before the console's scale. Orientations are relative to the start.

A message "increments" comes from a console that has already scaled its increments. The robot's tick
scales positions again in float32 and truncates them to whole micrometres. To make the result exact,
every position here is half a micrometre farther from zero than the intended whole number.
"""

from __future__ import annotations

import math

import numpy as np

from ravenjax.train.protocol import STALE_MS, Command, Json, itp_from_view, turn_vector
from ravenjax.train.robot import ARM_COLUMNS, ArmName, Arms, Quat, turn_by, unit_quaternion
from ravenjax.train.scenario import Speeds

STILL = (0.0,) * 7
"""Speeds of a hand at rest: move 3, turn 3, grasp."""
LEVEL: Quat = (0.0, 0.0, 0.0, 1.0)
"""The identity rotation."""
SMOOTHING_MS = 30.0
"""Time in which hands reach 90 % of a new speed; an assumption."""
_RATE = 3.8897 / SMOOTHING_MS
"""1/ms. A critically damped step, 1 - (1 + s) exp(-s), is 0.9 at s = 3.8897."""
_DECAY = math.exp(-_RATE)
# A hand below this share of full speed counts as at rest.
_AT_REST = 1e-6
# Smaller differences from the aim are set to zero.
_SETTLED = 1e-12
GRASP_MRAD = (-400.0, 1500.0)
"""Limits of the jaws: how far they open and close from the start, about 90 degrees open."""
FARTHEST_UM = 1_000_000.0
"""Limit of scaled positions. Up to here, single precision resolves half a micrometre."""


class Hands:
    """The hands of one operator, one for each arm, and the foot on the pedal."""

    _pedal = False
    # Tick of the last accepted message; -1: none yet.
    _heard = -1
    alive = False  # whether the last input is not stale

    def __init__(self, arms: Arms, scale: float, speeds: Speeds) -> None:
        """scale: tip motion per hand motion. speeds: of the tips at full deflection."""
        self.arms = arms
        self._scale = float(np.float32(scale))
        self._hands = {arm: _Hand(arm, speeds) for arm in self.arms}
        # The hands in this tick, ordered as a row of `Motion.table`; the pedal is last.
        self.columns = np.zeros(len(self.arms) * len(ARM_COLUMNS) + 1, np.float32)

    def apply(self, message: Command, tick: int) -> bool:
        """Apply a valid message "input" or "increments". Return False if it leads out of range."""
        tables = message["arms"]
        if message["type"] == "increments":
            given = [(hand, tables[arm]) for arm, hand in self._hands.items() if arm in tables]
            if not all(hand.has_room(increment) for hand, increment in given):
                return False
            for hand in self._hands.values():
                hand.aim(STILL)
            for hand, increment in given:
                hand.add(increment)
        else:
            for arm, hand in self._hands.items():
                hand.aim(_speeds(tables.get(arm, {})))
        self._pedal, self._heard = message["pedal"], tick
        return True

    def advance(self, tick: int) -> Hands:
        """Compute one millisecond of motion and return self. Call it once a tick."""
        alive = self.alive = self._heard >= 0 and tick - self._heard <= STALE_MS
        values: list[float] = []
        for hand in self._hands.values():
            if alive:
                hand.step()
            else:
                hand.stop()
            values += hand.columns(self._scale)
        values.append(1.0 if alive and self._pedal else 0.0)
        self.columns[:] = values
        return self

    def move_to(self, columns: np.ndarray) -> None:
        """Put the hands, at rest, where a row of motion has them. The next row then equals it."""
        width = len(ARM_COLUMNS)
        for i, hand in enumerate(self._hands.values()):
            hand.stop()
            hand.move_to(columns[i * width : (i + 1) * width].tolist(), self._scale)


class _Hand:
    """One hand: its scaled position, and its speed along the ITP axes in shares of full speed."""

    _quat = LEVEL
    _grasped = 0.0
    _aim: tuple[float, ...] = STILL
    _moving = False

    def __init__(self, arm: ArmName, speeds: Speeds) -> None:
        self._axes = itp_from_view(arm)
        self._move = speeds.move_mm_s  # um of the tip per ms
        self._turn = speeds.turn_rad_s * 1e-3
        self._grasp_step = speeds.grasp_mrad_s * 1e-3
        self._x = [0.0] * 3  # um after scaling
        self._v = [0.0] * 7
        self._change = [0.0] * 7  # rate of change of the speeds, per ms

    def aim(self, speeds: tuple[float, ...]) -> None:
        """Set the speeds to reach, each -1 to 1: move 3 and turn 3 in axes of the view, grasp."""
        if any(speeds):
            move, turn = turn_vector(self._axes, speeds[0:3]), turn_vector(self._axes, speeds[3:6])  # type: ignore[arg-type]
            self._aim, self._moving = (*move, *turn, speeds[6]), True
        else:
            self._aim = STILL

    def stop(self) -> None:
        if self._moving:
            self._aim, self._moving = STILL, False
            self._v, self._change = [0.0] * 7, [0.0] * 7

    def step(self) -> None:
        # Changes the speed smoothly to the one that the page requests, and moves the hand.
        if not self._moving:
            return
        v, change = self._v, self._change
        # Exact solution of a critically damped second-order system.
        for i, aim in enumerate(self._aim):
            off = v[i] - aim
            if off or change[i]:
                slope = change[i] + _RATE * off
                v[i] = aim + (off + slope) * _DECAY
                change[i] = (change[i] - _RATE * slope) * _DECAY
                if abs(off) < _SETTLED and abs(change[i]) < _SETTLED:
                    v[i], change[i] = aim, 0.0
        if self._aim is STILL and max(map(abs, v)) < _AT_REST:
            self.stop()
            return
        x, far = self._x, self._move
        for i in (0, 1, 2):
            moved = x[i] + v[i] * far
            if -FARTHEST_UM < moved < FARTHEST_UM:
                x[i] = moved
        if v[6]:
            low, high = GRASP_MRAD
            wanted = self._grasped + v[6] * self._grasp_step
            self._grasped = min(max(wanted, min(low, self._grasped)), max(high, self._grasped))
        if v[3] or v[4] or v[5]:
            half = 0.5 * self._turn
            turn = unit_quaternion((v[3] * half, v[4] * half, v[5] * half, 1.0))
            self._quat = turn_by(self._quat, turn)

    def has_room(self, increment: Json) -> bool:
        x = [a + d for a, d in zip(self._x, increment["delta_um"], strict=True)]
        x.append(self._grasped + increment.get("grasp_mrad", 0.0))
        return max(map(abs, x)) <= FARTHEST_UM

    def add(self, increment: Json) -> None:
        for i, d in enumerate(increment["delta_um"]):
            self._x[i] += d
        self._grasped += increment.get("grasp_mrad", 0.0)
        quat = tuple(increment.get("quat", LEVEL))
        if quat != LEVEL:
            self._quat = turn_by(self._quat, quat)

    def columns(self, scale: float) -> list[float]:
        per_um = 1.0 / scale
        position = (_beyond(x) * per_um for x in self._x)
        return [*position, *self._quat, _beyond(self._grasped)]

    def move_to(self, values: list[float], scale: float) -> None:
        """Set the position from the arm's columns in a row of motion."""
        self._x = [_within(x * scale) for x in values[0:3]]
        self._quat = unit_quaternion(tuple(values[3:7]))  # type: ignore[arg-type]
        self._grasped = _within(values[7])


def _speeds(given: Json) -> tuple[float, ...]:
    """Return an arm's speeds ordered as STILL: move and turn at most of length 1, grasp -1 to 1."""
    speeds: list[float] = []
    for name in ("move", "turn"):
        vector = given.get(name, STILL[:3])
        length = max(1.0, math.hypot(*vector))
        speeds += [x / length for x in vector]
    return *speeds, min(max(given.get("grasp", 0.0), -1.0), 1.0)


def _beyond(x: float) -> float:
    """Return `x` half a unit farther from zero, which truncates to the nearest whole number."""
    return x + 0.5 if x > 0.0 else x - 0.5 if x < 0.0 else 0.0


def _within(x: float) -> float:
    """Return the inverse of `_beyond`; 0 for values that `_beyond` never returns."""
    return x - 0.5 if x > 0.5 else x + 0.5 if x < -0.5 else 0.0
