"""The virtual robots and their bare rotors as predictors of the recorded joints 1-3, in closed
and in open loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ravenjax.numbers.lazy import jax, jnp
from ravenjax.robots.raven2.geometry import transmission
from studies.dsn16.recording import closed_loop, horizons
from studies.dsn16.recording.closed_loop import JointRecording, Rows
from studies.dsn16.recording.horizons import (
    CLOSED,
    OPEN,
    Ahead,
    Model,
    Predictor,
    RecordedStretch,
)

TO_JOINT = np.array((180.0 / math.pi, 180.0 / math.pi, 1e3)) / np.array(transmission.TR[:3])
"""deg, deg and mm of the joint per rad of its motor."""
UNITS = {"shoulder": "deg", "elbow": "deg", "insertion": "mm"}
LOOPS: dict[Rows, str] = {"asked": CLOSED, "dac": OPEN}


def second_half(log: JointRecording) -> JointRecording:
    """What no parameter of any set was fitted to here."""
    return JointRecording(*(part[len(log.angle) // 2 :] for part in log))


def stretch(log: JointRecording) -> RecordedStretch:
    """All of `log`, at the joints."""
    return RecordedStretch(log.angle * TO_JOINT, log.speed * TO_JOINT, 1.0, UNITS)


def of(log: JointRecording) -> list[Predictor]:
    """Every robot and its rotors in both loops; they need 64 bits."""
    models = horizons.models(closed_loop.SETUP, closed_loop.ARM)
    predictors = []
    for rows, name in LOOPS.items():
        run = _compiled(rows)
        predictors += [
            Predictor(name, model.name, _ahead(log, rows, model, run)) for model in models
        ]
    return predictors


def _compiled(rows: Rows) -> Callable[..., jax.Array]:
    """(parameters, cables, angles and speeds [s, 3], inputs [s, T, 3]) -> motors [s, T, 7]."""

    def run(params, cables, angle, speed, inputs):
        return jax.vmap(closed_loop.loop(rows, params, cables))(angle, speed, inputs)[0]

    return jax.jit(run)


def _ahead(log: JointRecording, rows: Rows, model: Model, run: Callable[..., jax.Array]) -> Ahead:
    inputs = log.asked if rows == "asked" else log.dac

    def ahead(starts: np.ndarray, length: int) -> np.ndarray:
        windows = np.stack([inputs[start : start + length] for start in starts])
        motors = run(
            model.params,
            model.cables,
            *map(jnp.asarray, (log.angle[starts], log.speed[starts], windows)),
        )
        return np.asarray(motors)[:, :, :3] * TO_JOINT

    return ahead
