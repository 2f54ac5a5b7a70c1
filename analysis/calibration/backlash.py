"""Computes upper bounds for the backlash of the recorded arms. Prints Markdown.

    RAVENJAX_DATA=FOLDER python analysis/calibration/backlash.py

The recordings contain motor positions, but no joint positions. Backlash is visible when a motor
reverses: until the motor has crossed the gap, it does not have to overcome the dry friction of the
joint. The motor torque, computed from the recorded error and the controller's PID law, therefore
reaches its new level only after the gap. The motor's travel until the torque has made 90 % of its
change is an upper bound of the gap. It also includes all other effects that soften a reversal.

The same bound is computed for the virtual robot, which has no backlash, with the same desired
motion. If both bounds are equal, the bound is due to the controller, and the recording gives no
smaller bound.

Torque levels before and after a reversal are medians over the middle 40 % of the strokes. A stroke
is longer than the share `LEAST` of the joint's range of motion in the recording.
"""

import sys
from pathlib import Path

import numpy as np

from ravenjax.analyses.calibration import position_loop, tables
from ravenjax.analyses.calibration.calibrate import LoggedRobot
from ravenjax.document.html import markdown_table
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot

sys.path.insert(0, str(Path(__file__).parents[1]))

from studies import mechanics
from studies.dsn16 import recording

REACHED, LEAST, SMOOTH_MS = 0.9, 0.1, 25.0
MIDDLE = (0.3, 0.7)


def torques(
    logged: LoggedRobot, joints: np.ndarray, period_ms: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return motor angles (rad) and the torques that the controller then commands (N m), [n, 7]
    each, with the same smoothing.
    """
    tool = logged.setup.tools[logged.setup.arms.index(logged.arm)]
    period = period_ms * 1e-3
    desired = logged.log.desired[logged.log.cycles]
    apart, motors = (
        np.stack(
            [
                *transmission.motor_from_joint(
                    logged.arm, tool, Vec(x.T), 0.0, logged.setup.software
                )
            ],
            axis=1,
        )
        for x in (desired - joints, joints)
    )
    kp, kd, ki = (np.array([*gain]) for gain in logged.controller[:3])
    torque = (
        kp * apart
        - kd * np.gradient(motors, period, axis=0)
        + ki * np.cumsum(apart, axis=0) * period
    )
    length = round(SMOOTH_MS / period_ms)
    window = np.ones(length) / length
    return motors, np.stack([np.convolve(column, window, "same") for column in torque.T], axis=1)


def turns(angle: np.ndarray, least: float) -> list[int]:
    """Return the rows at which the angle [n] turns back after at least `least` of travel."""
    ends, extreme, sign = [0], 0, 0
    for k in range(1, len(angle)):
        ahead = sign * (angle[k] - angle[extreme])
        if sign == 0 and abs(angle[k] - angle[0]) >= least:
            sign, extreme = int(np.sign(angle[k] - angle[0])), k
        elif ahead >= 0.0:
            extreme = k
        elif -ahead >= least:
            ends.append(extreme)
            extreme, sign = k, -sign
    return ends


def travels(angle: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Return the motor travel (rad) after each reversal until the torque has made REACHED of its
    way to the new level.
    """
    ends = turns(angle, LEAST * np.ptp(angle))
    travel = []
    for begin, at, end in zip(ends, ends[1:], ends[2:], strict=False):
        levels = []
        for a, b in ((begin, at), (at, end)):
            share = np.abs(angle[a:b] - angle[a]) / max(abs(angle[b] - angle[a]), 1e-9)
            levels.append(np.median(torque[a:b][(share > MIDDLE[0]) & (share < MIDDLE[1])]))
        way = (torque[at:end] - levels[0]) / (levels[1] - levels[0])
        reached = np.flatnonzero(way >= REACHED)
        if len(reached):
            travel.append(abs(angle[at + reached[0]] - angle[at]))
    return np.array(travel)


def rows(name: str, logged: LoggedRobot, period_ms: float) -> list[tuple[str, ...]]:
    """Return one row per joint of a recorded arm, with the virtual arm's values."""
    whole = logged.log.compared(0, len(logged.log.desired))
    params = position_loop.params(robot.params(logged.setup, logged.arm))
    sides = [
        torques(logged, np.nan_to_num(joints), period_ms)
        for joints in (logged.log.measured, logged.replay(whole, [params])[0])
    ]
    lines = []
    for j in logged.log.joints:
        cells = []
        for angle, torque in sides:
            first = round(1000.0 / period_ms)
            travel = (
                travels(angle[first:, j], torque[first:, j])
                * tables.PER_UNIT[j]
                / transmission.TR[j]
            )
            low, middle, high = (
                np.quantile(travel, (0.1, 0.5, 0.9)) if len(travel) else (np.nan,) * 3
            )
            cells.append(f"{middle:.3f} ({low:.3f} to {high:.3f}), {len(travel)}")
        lines.append((name, f"{JOINTS[j].replace('_', ' ')}, {tables.UNITS[j]}", *cells))
    return lines


def main() -> None:
    """Print the results of both recorded arms."""
    lines: list[tuple[str, ...]] = []
    for name, file, period_ms in (
        ("the authors' arm", mechanics.THREE_JOINTS, 1.0),
        ("the arm of 2018", mechanics.SEVEN_JOINTS, mechanics.SEVEN_PERIOD_MS),
    ):
        path = recording.locate(file)
        if path is None:
            raise FileNotFoundError(f"{file}: set {recording.DATA} to its folder")
        lines += rows(name, mechanics.logged(file, path), period_ms)
    columns = (
        "arm",
        "joint",
        "recorded: median (10 % to 90 %), reversals",
        "virtual, without a gap",
    )
    print(markdown_table(columns, lines))


if __name__ == "__main__":
    main()
