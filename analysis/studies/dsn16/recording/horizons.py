"""How far predictions of a recorded robot err after 20, 50 and 128 ms and over a whole stretch,
beside null models.

The one definition for every comparison with a recording. Each prediction starts from the recorded
joints and speeds of a stretch that no parameter was fitted to. A null model knows nothing of the
arm: it holds the position or the velocity, or it is a bare rotor, a motor with viscous friction
whose cables are all cut. Errors are of motors, at the joint. One recording of one robot is no
sample: means and largest errors have no interval.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.calibration import replay
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

HORIZONS_MS = (20, 50, 128)
EVERY_MS = 200
"""From one start to the next."""
CLOSED, OPEN, NO_LOOP = "closed loop", "open loop", "no loop"
"""Driven by what the robot was asked for, by the recorded DAC, or by nothing."""
HELD_POSITION, HELD_VELOCITY = "null: hold the position", "null: hold the velocity"
SETS = ("power_consistent", "traj3")
"""Of the virtual robots that are compared."""
ROTORS = "null: bare rotors"


class Model(NamedTuple):
    """A virtual robot, or what is left of it with every cable cut."""

    name: str
    params: robot.PlantParams
    cables: float  # times the stiffness and damping of every cable


def models(setup: RavenSetup, arm: ArmName) -> list[Model]:
    """The virtual robot with each set, and the bare rotors of each."""
    sets = {name: robot.params(setup, arm, name) for name in SETS}
    robots = [Model(f"virtual robot, {name}", params, 1.0) for name, params in sets.items()]
    rotors = [
        Model(f"{ROTORS}, {name}", replay.bare_rotors(params), 0.0) for name, params in sets.items()
    ]
    return [*robots, *rotors]


class RecordedStretch(NamedTuple):
    """A part of a recording that nothing was fitted to; [n, joints] each, rows `period_ms`
    apart.
    """

    angle: np.ndarray  # by the motors, in the unit of its joint
    speed: np.ndarray  # the same per s, from the row and earlier ones
    period_ms: float
    units: dict[str, str]  # joint -> deg or mm

    def rows(self, horizon_ms: float) -> int:
        """Rows to the one nearest to a horizon."""
        return round(horizon_ms / self.period_ms)

    @property
    def starts(self) -> np.ndarray:
        """Rows from which the short predictions start, the longest of which ends inside."""
        return np.arange(0, len(self.angle) - self.rows(max(HORIZONS_MS)), self.rows(EVERY_MS))


Ahead = Callable[[np.ndarray, int], np.ndarray]
"""(starts [s], rows) -> joints of the next `rows` rows after each start, [s, rows, joints]."""


class Predictor(NamedTuple):
    """A robot or a null model of a stretch."""

    loop: str
    model: str
    ahead: Ahead


class HorizonError(NamedTuple):
    """Absolute errors of one model at one horizon, by joint in the stretch's units."""

    loop: str
    model: str
    horizon_ms: int | None  # None: the whole stretch from its beginning
    mean: np.ndarray
    largest: np.ndarray


def held(part: RecordedStretch) -> tuple[Predictor, Predictor]:
    """The two null models that need no robot."""

    def ahead(velocity: float) -> Ahead:
        def run(starts: np.ndarray, rows: int) -> np.ndarray:
            seconds = np.arange(1, rows + 1)[:, None] * part.period_ms * 1e-3
            return part.angle[starts, None] + velocity * part.speed[starts, None] * seconds

        return run

    return Predictor(NO_LOOP, HELD_POSITION, ahead(0.0)), Predictor(
        NO_LOOP, HELD_VELOCITY, ahead(1.0)
    )


def compare(part: RecordedStretch, models: Sequence[Predictor]) -> list[HorizonError]:
    """Every model, and those of `held`, at every horizon and over the whole stretch."""
    ends = [part.rows(horizon) for horizon in HORIZONS_MS]
    errors = []
    for loop, model, ahead in (*models, *held(part)):
        short = ahead(part.starts, max(ends))
        for horizon, end in zip(HORIZONS_MS, ends, strict=True):
            errors.append(
                _error(loop, model, horizon, short[:, end - 1] - part.angle[part.starts + end])
            )
        whole = ahead(np.zeros(1, int), len(part.angle) - 1)[0]
        errors.append(_error(loop, model, None, whole - part.angle[1:]))
    return errors


def _error(loop: str, model: str, horizon_ms: int | None, apart: np.ndarray) -> HorizonError:
    return HorizonError(
        loop, model, horizon_ms, np.abs(apart).mean(axis=0), np.abs(apart).max(axis=0)
    )
