"""Converts the messages of consoles into the motion of the operator's hands, one row for each tick.

Speeds of "input" messages are along the axes of the view. The hands change their speed smoothly:
critically damped, with 90 % of the change after `SMOOTHING_MS`. Positions are positions of the
hand, in micrometres, in the ITP frame of the arm. The robot's tick multiplies them by the scale. A
console that sends "increments" has already scaled them, so they are divided by the scale here.
Orientations are relative to the start. The tick truncates to whole micrometres. Every position is
moved half a micrometre away from zero here, so that the tick yields the nearest whole micrometre.
"""

from __future__ import annotations

import math

import numpy as np

from ravenjax.train.protocol import STALE_MS, Command, Json, itp_from_view, turn_vector
from ravenjax.train.robot import ARM_COLUMNS, ArmName, Arms, Quat, turn_by, unit_quaternion
from ravenjax.train.scenario import Speeds

STILL = (0.0,) * 7  # Speeds of a hand at rest: move 3, turn 3, grasp
IDENTITY: Quat = (0.0, 0.0, 0.0, 1.0)  # The identity rotation
SMOOTHING_MS = 30.0  # Time in which hands reach 90 % of a new speed; an assumption
_RATE = 3.8897 / SMOOTHING_MS
"""1/ms. A critically damped step, 1 - (1 + s) exp(-s), is 0.9 at s = 3.8897."""
_DECAY = math.exp(-_RATE)
_MIN_SPEED = 1e-6  # A hand below this share of full speed is at rest
# A speed is equal to the wanted speed if the difference is smaller.
_MIN_DIFFERENCE = 1e-12
GRASP_MRAD = (-400.0, 1500.0)
"""Limits of the jaws: how far they open and close from the start, about 90 degrees open."""
MAX_POSITION_UM = 1_000_000.0
"""Limit of scaled positions. Up to here, single precision resolves half a micrometre."""


class Hands:
    """The hands of one operator, one for each arm, and the foot on the pedal."""

    _pedal = False
    _last_input_tick = -1  # Tick of the last accepted message; -1: none yet
    alive = False  # whether the last input is not stale

    def __init__(self, arms: Arms, scale: float, speeds: Speeds):
        """scale: tip motion per hand motion. speeds: of the tips at full deflection."""
        self.arms = arms
        # The robot's tick multiplies by the scale in single precision.
        self._scale = float(np.float32(scale))
        self._hands = {arm: _Hand(arm, speeds) for arm in self.arms}
        # The hands in this tick, ordered as a row of `Motion.table`; the pedal is last.
        self.columns = np.zeros(len(self.arms) * len(ARM_COLUMNS) + 1, np.float32)

    def apply(self, message: Command, tick: int) -> bool:
        """Apply a valid message "input" or "increments", which a console sends. Return False, and
        change nothing, if an increment leads out of the range of positions.
        """
        tables = message["arms"]
        if message["type"] == "increments":
            moved = [(hand, tables[arm]) for arm, hand in self._hands.items() if arm in tables]
            if not all(hand.is_in_range(increment) for hand, increment in moved):
                return False
            for hand in self._hands.values():
                hand.set_speeds(STILL)
            for hand, increment in moved:
                hand.add(increment)
        else:
            for arm, hand in self._hands.items():
                hand.set_speeds(_limit_speeds(tables.get(arm, {})))
        self._pedal, self._last_input_tick = message["pedal"], tick
        return True

    def advance(self, tick: int) -> Hands:
        """Compute one millisecond of motion and return self. Call it once a tick. Without recent
        input, the hands stop at once and the pedal is up.
        """
        alive = self.alive = self._last_input_tick >= 0 and tick - self._last_input_tick <= STALE_MS
        values = []
        for hand in self._hands.values():
            if alive:
                hand.step()
            else:
                hand.stop()
            values += hand.columns(self._scale)
        values.append(float(alive and self._pedal))
        self.columns[:] = values
        return self

    def move_to(self, columns: np.ndarray) -> None:
        """Put the hands, at rest, at the positions in a row of a motion table. columns: the row.
        The next row of the resting hands is equal to it.
        """
        width = len(ARM_COLUMNS)
        for i, hand in enumerate(self._hands.values()):
            hand.stop()
            hand.move_to(columns[i * width : (i + 1) * width].tolist(), self._scale)


class _Hand:
    """One hand: its scaled position, and its speed along the ITP axes in shares of full speed."""

    _quat = IDENTITY
    _grasp_mrad = 0.0
    _wanted_speeds: tuple[float, ...] = STILL
    _moving = False

    def __init__(self, arm: ArmName, speeds: Speeds):
        self._axes = itp_from_view(arm)
        self._move_step = speeds.move_mm_s  # um of the tip per ms
        self._turn_step = speeds.turn_rad_s * 1e-3
        self._grasp_step = speeds.grasp_mrad_s * 1e-3
        self._position_um = [0.0] * 3  # after scaling
        # Ordered as STILL: shares of full speed, and their change, 1/ms.
        self._speeds = [0.0] * 7
        self._accelerations = [0.0] * 7

    def set_speeds(self, speeds: tuple[float, ...]) -> None:
        """Set the speeds to reach, each -1 to 1: move 3 and turn 3 in axes of the view, grasp."""
        if any(speeds):
            move, turn = turn_vector(self._axes, speeds[0:3]), turn_vector(self._axes, speeds[3:6])  # type: ignore[arg-type]
            self._wanted_speeds, self._moving = (*move, *turn, speeds[6]), True
        else:
            self._wanted_speeds = STILL

    def stop(self) -> None:
        """Stop at once, without a smooth change of speed."""
        if self._moving:
            self._wanted_speeds, self._moving = STILL, False
            self._speeds, self._accelerations = [0.0] * 7, [0.0] * 7

    def step(self) -> None:
        # Changes the speeds (move 3, turn 3, grasp) smoothly to the wanted ones. Moves the hand.
        if not self._moving:
            return
        v, acceleration = self._speeds, self._accelerations
        # Critically damped: with rate r, the difference d to the wanted speed is after t ms
        # (d + (d' + r d) t) exp(-r t). Here t = 1 ms, and `slope` is d' + r d.
        for i, wanted in enumerate(self._wanted_speeds):
            difference = v[i] - wanted
            if difference or acceleration[i]:
                slope = acceleration[i] + _RATE * difference
                v[i] = wanted + (difference + slope) * _DECAY
                acceleration[i] = (acceleration[i] - _RATE * slope) * _DECAY
                if abs(difference) < _MIN_DIFFERENCE and abs(acceleration[i]) < _MIN_DIFFERENCE:
                    v[i], acceleration[i] = wanted, 0.0
        if self._wanted_speeds is STILL and max(map(abs, v)) < _MIN_SPEED:
            self.stop()
            return
        position, step = self._position_um, self._move_step
        for i in (0, 1, 2):
            moved = position[i] + v[i] * step
            if -MAX_POSITION_UM < moved < MAX_POSITION_UM:
                position[i] = moved
        if v[6]:
            low, high = GRASP_MRAD
            wanted = self._grasp_mrad + v[6] * self._grasp_step
            # A console's increments may have moved the jaws beyond a limit. The present position is
            # then the limit, so that the jaws can only move back.
            low, high = min(low, self._grasp_mrad), max(high, self._grasp_mrad)
            self._grasp_mrad = min(max(wanted, low), high)
        if v[3] or v[4] or v[5]:
            # The quaternion of a small rotation vector, which has half its length.
            half = 0.5 * self._turn_step
            turn = unit_quaternion((v[3] * half, v[4] * half, v[5] * half, 1.0))
            self._quat = turn_by(self._quat, turn)

    def is_in_range(self, increment: Json) -> bool:
        """Whether position (um) and grasp (mrad) stay within the number `MAX_POSITION_UM`."""
        pairs = zip(self._position_um, increment["delta_um"], strict=True)
        values = [position + delta for position, delta in pairs]
        values.append(self._grasp_mrad + increment.get("grasp_mrad", 0.0))
        return max(map(abs, values)) <= MAX_POSITION_UM

    def add(self, increment: Json) -> None:
        for i, d in enumerate(increment["delta_um"]):
            self._position_um[i] += d
        self._grasp_mrad += increment.get("grasp_mrad", 0.0)
        quat = tuple(increment.get("quat", IDENTITY))
        if quat != IDENTITY:
            self._quat = turn_by(self._quat, quat)

    def columns(self, scale: float) -> list[float]:
        """Return the columns of a motion table: position before scaling, quaternion, grasp."""
        per_um = 1.0 / scale
        position = (_away_from_zero(x) * per_um for x in self._position_um)
        return [*position, *self._quat, _away_from_zero(self._grasp_mrad)]

    def move_to(self, values: list[float], scale: float) -> None:
        """Set the position to that of `columns` [8] of a row of motion. Inverse of `columns`."""
        self._position_um = [_toward_zero(x * scale) for x in values[0:3]]
        self._quat = unit_quaternion(tuple(values[3:7]))  # type: ignore[arg-type]
        self._grasp_mrad = _toward_zero(values[7])


def _limit_speeds(given: Json) -> tuple[float, ...]:
    """Return the speeds of one arm in a message "input", ordered as STILL. Vectors "move" and
    "turn" longer than 1 are shortened to length 1, and "grasp" is limited to -1 to 1.
    """
    speeds = []
    for name in ("move", "turn"):
        vector = given.get(name, STILL[:3])
        divisor = max(1.0, math.hypot(*vector))
        speeds += [x / divisor for x in vector]
    return *speeds, min(max(given.get("grasp", 0.0), -1.0), 1.0)


def _away_from_zero(x: float) -> float:
    """Return `x` half a unit farther from zero, which truncates to the nearest whole number."""
    return x + 0.5 if x > 0.0 else x - 0.5 if x < 0.0 else 0.0


def _toward_zero(x: float) -> float:
    """Return the inverse of `_away_from_zero`, or 0 for values that it never returns."""
    return x - 0.5 if x > 0.5 else x + 0.5 if x < -0.5 else 0.0
