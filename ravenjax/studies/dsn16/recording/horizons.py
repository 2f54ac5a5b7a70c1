"""How far predictions of a recorded robot err after 20, 50 and 128 ms and over the whole of it, beside null models.

Every prediction starts from the recorded angle and speed. A null model knows nothing of the arm: it holds the position
or the velocity, or it is a bare rotor, the virtual robot with every cable cut. Errors are of motors, at the joint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ravenjax.robots.raven2.geometry import transmission
from ravenjax.stats.bootstrap.resample import bootstrap
from ravenjax.studies.dsn16.recording.closed_loop import JointRecording, loop

HORIZONS_MS = (20, 50, 128)
EVERY_MS = 200
"""From one start to the next."""
SETTLING_MS = 200
"""At the start the cables' stretch is not known."""
BLOCKS = 10
"""Stretches of the recording, over which the bootstrap of a mean goes."""
TO_JOINT = np.array((180.0 / math.pi, 180.0 / math.pi, 1e3)) / np.array(transmission.TR[:3])
"""deg, deg and mm of the joint per rad of its motor."""

Rows = Literal["asked", "dac"]
LOOPS: dict[Rows, str] = {"asked": "closed loop", "dac": "open loop"}
ROBOT, ROTOR = "virtual robot", "null: bare rotor (cables cut)"
CABLES = {ROBOT: 1.0, ROTOR: 0.0}
NO_LOOP, HELD_POSITION, HELD_VELOCITY = "no loop", "null: hold the position", "null: hold the velocity"


class Error(NamedTuple):
    """Absolute errors of joints 1-3: mean with its 95 % band over stretches of the recording, and the largest."""

    mean: np.ndarray  # [3] deg, deg, mm
    low: np.ndarray
    high: np.ndarray
    largest: np.ndarray


class HorizonError(NamedTuple):
    """One row of the comparison."""

    loop: str  # one of LOOPS
    model: str
    horizon_ms: int | None  # None: mean over the whole recording
    error: Error


def error_of(apart: np.ndarray) -> Error:
    """Of absolute errors [n, 3] in the order of time."""
    stretches = np.array([part.mean(axis=0) for part in np.array_split(apart, BLOCKS)])
    bands = [bootstrap(len(stretches), lambda rows, k=k: stretches[rows, k].mean(axis=1)) for k in range(3)]
    low, high = (np.array([float(getattr(band, end)) for band in bands]) for end in ("low", "high"))
    return Error(apart.mean(axis=0), low, high, apart.max(axis=0))


def compare(log: JointRecording) -> Iterator[HorizonError]:
    """Every model in open and in closed loop at every horizon; needs 64 bits."""
    angle, speed, steps = log.angle, log.speed, np.arange(1, len(log.angle))
    starts = np.arange(SETTLING_MS, len(angle) - max(HORIZONS_MS), EVERY_MS)
    for rows, name in LOOPS.items():
        inputs = log.asked if rows == "asked" else log.dac
        windows = np.stack([inputs[s : s + max(HORIZONS_MS)] for s in starts])
        for model, cables in CABLES.items():
            run = loop(rows, cables=cables)
            short = np.asarray(jax.jit(jax.vmap(run))(*map(jnp.asarray, (angle[starts], speed[starts], windows)))[0])
            for horizon in HORIZONS_MS:
                apart = np.abs(short[:, horizon - 1, :3] - angle[starts + horizon]) * TO_JOINT
                yield HorizonError(name, model, horizon, error_of(apart))
            whole = np.asarray(jax.jit(run)(*map(jnp.asarray, (angle[0], speed[0], inputs)))[0])
            apart = np.abs(whole[:-1, :3] - angle[1:]) * TO_JOINT
            yield HorizonError(name, model, None, error_of(apart[SETTLING_MS:]))
    for model, velocity in ((HELD_POSITION, 0.0), (HELD_VELOCITY, 1.0)):
        for horizon in HORIZONS_MS:
            ahead = angle[starts] + velocity * speed[starts] * horizon * 1e-3
            yield HorizonError(NO_LOOP, model, horizon, error_of(np.abs(ahead - angle[starts + horizon]) * TO_JOINT))
        ahead = angle[0] + velocity * speed[0] * steps[:, None] * 1e-3
        yield HorizonError(NO_LOOP, model, None, error_of((np.abs(ahead - angle[1:]) * TO_JOINT)[SETTLING_MS:]))
