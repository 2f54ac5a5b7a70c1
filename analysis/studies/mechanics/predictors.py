"""The virtual robots and their bare rotors as predictors of a log of seven joints, in closed loop.

Its motor commands were not recorded, so there is no open loop. Nor was what the tool's controllers
had integrated at a start: each model starts with the torque that its own controller has there when
it is replayed from the log's beginning.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ravenjax.analyses.calibration import replay, tables
from ravenjax.analyses.calibration.calibrate import LoggedRobot
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from studies.dsn16.recording import horizons
from studies.dsn16.recording.horizons import (
    CLOSED,
    Ahead,
    Model,
    Predictor,
    RecordedStretch,
)

SLOPE_ROWS = 5
"""Rows, some 20 ms, whose straight line gives the speed at the last of them."""


def second_half(logged: LoggedRobot) -> np.ndarray:
    """Rows of the log's measured joints to which no parameter was fitted."""
    return np.flatnonzero(logged.log.cycles >= len(logged.log.desired) // 2)


def stretch(logged: LoggedRobot, rows: np.ndarray, period_ms: float) -> RecordedStretch:
    """Some rows of a log that has all seven joints."""
    units = {
        joint.replace("_", " "): unit for joint, unit in zip(JOINTS, tables.UNITS, strict=True)
    }
    measured, speed = (
        logged.log.measured * tables.PER_UNIT,
        speeds(logged.log.measured, period_ms) * tables.PER_UNIT,
    )
    return RecordedStretch(measured[rows], speed[rows], period_ms, units)


def speeds(measured: np.ndarray, period_ms: float) -> np.ndarray:
    """Slope of a line through each row and the SLOPE_ROWS - 1 before it, per s; [n, 7]. 0 in the
    first rows.
    """
    weight = np.arange(SLOPE_ROWS) - (SLOPE_ROWS - 1) / 2.0
    weight = weight / (weight @ weight) / (period_ms * 1e-3)
    last = len(measured) - SLOPE_ROWS + 1
    slope = sum(w * measured[i : i + last] for i, w in enumerate(weight))
    return np.vstack([np.zeros((SLOPE_ROWS - 1, measured.shape[1])), np.asarray(slope)])


def of(logged: LoggedRobot, rows: np.ndarray, period_ms: float) -> list[Predictor]:
    """Every robot and its rotors, of the stretch of these rows."""
    setup, arm, log = logged.setup, logged.arm, logged.log

    def replayed(params, cables, first, desired, speed, integral):
        run = replay.replay(setup, arm, logged.controller, cables)
        return jax.vmap(run, in_axes=(None, 0, 0, 0, 0))(params, first, desired, speed, integral)

    run = jax.jit(replayed)

    def joints(
        model: Model,
        first: np.ndarray,
        desired: np.ndarray,
        speed: np.ndarray,
        integral: np.ndarray,
    ):
        state = (
            jnp.asarray(part, setup.precision.real) for part in (first, desired, speed, integral)
        )
        return np.asarray(run(model.params, model.cables, *state), float)

    rest = np.zeros((1, log.measured.shape[1]))
    predictors = []
    for model in horizons.models(setup, arm):
        course = joints(model, log.start[None], log.desired[None], rest, rest)[0]
        begun = integrals(logged, course)
        predictors.append(
            Predictor(CLOSED, model.name, _ahead(logged, rows, period_ms, model, joints, begun))
        )
    return predictors


def _ahead(
    logged: LoggedRobot,
    rows: np.ndarray,
    period_ms: float,
    model: Model,
    joints: Callable[..., np.ndarray],
    begun: np.ndarray,
) -> Ahead:
    """begun: what the model's controllers have integrated before each cycle."""
    log, speed = logged.log, speeds(logged.log.measured, period_ms)

    def ahead(starts: np.ndarray, length: int) -> np.ndarray:
        first = rows[starts]
        begin, end = log.cycles[first] + 1, log.cycles[first + length] + 1
        cycles = np.minimum(begin[:, None] + np.arange((end - begin).max()), len(log.desired) - 1)
        course = joints(model, log.measured[first], log.desired[cycles], speed[first], begun[begin])
        read = log.cycles[first[:, None] + np.arange(1, length + 1)] - begin[:, None]
        return course[np.arange(len(starts))[:, None], read] * tables.PER_UNIT

    return ahead


def integrals(logged: LoggedRobot, course: np.ndarray) -> np.ndarray:
    """What gives controllers at the recorded joints the torque that they have in a replay, before
    each cycle.

    Motors, rad s; 0 of those without an integral.

    course: joints after each cycle of the replay, [T, 7] as the result.
    """
    log, gains = logged.log, logged.controller
    clock = np.arange(len(log.desired))
    recorded = np.stack(
        [np.interp(clock, log.cycles + 1, column) for column in log.measured.T], axis=1
    )
    own = _motor_errors(logged, np.vstack([log.start, course[:-1]]))
    kp, ki = (np.array([*gain]) for gain in (gains.kp, gains.ki))
    integral = np.cumsum(own, axis=0) * robot.TICK_S - own * robot.TICK_S
    moved = kp * (own - _motor_errors(logged, recorded))
    return np.where(ki > 0.0, integral + moved / np.where(ki > 0.0, ki, 1.0), 0.0)


def _motor_errors(logged: LoggedRobot, joints: np.ndarray) -> np.ndarray:
    """Desired minus these joints at the motors, rad, [T, 7]; those of the tool with the insertion
    where it is, since the controller asks them to follow the measured one."""
    tool = logged.setup.tools[logged.setup.arms.index(logged.arm)]
    apart = Vec((logged.log.desired - joints).T)
    return np.stack(
        transmission.motor_from_joint(logged.arm, tool, apart, 0.0, logged.setup.software), axis=1
    )
