"""The whole of it: a log in, the parameters out, judged on the part of the log kept back for that."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ravenjax.calibration import fit as fitting
from ravenjax.calibration import judgement, parameters
from ravenjax.calibration.judgement import FollowingError
from ravenjax.calibration.log import JointLog
from ravenjax.calibration.parameters import Unknown
from ravenjax.calibration.replay import Controller, replay
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

SETTLING = 1000
"""Cycles at a log's beginning that are not compared: how the cables were loaded there is not known."""
LOG, ROTOR = "the recording", "null: bare rotors"


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What a log says of a robot."""

    unknowns: tuple[Unknown, ...]
    before: np.ndarray  # [k] values before, in their units
    fit: fitting.Fit

    @property
    def after(self) -> np.ndarray:
        """[k] most probable values, in their units."""
        steps = self.fit.steps
        moved = (parameters.moved_by(self.before[k], one, steps[k]) for k, one in enumerate(self.unknowns))
        return np.array([float(value) for value in moved])

    @property
    def told(self) -> np.ndarray:
        """Standard deviation after the log by that before it, [k]: 1 where the log tells nothing."""
        return np.sqrt(np.diag(self.fit.covariance))


@dataclasses.dataclass(frozen=True)
class LoggedRobot:
    """A log with the robot that it is of: which arm, how its software strings the tool, which controller."""

    log: JointLog
    setup: RavenSetup
    arm: ArmName
    controller: Controller

    @property
    def halves(self) -> tuple[JointLog, JointLog]:
        """What is fitted to, and what is kept back; both are replayed from the log's beginning."""
        whole = len(self.log.desired)
        return self.log.compared(SETTLING, whole // 2), self.log.compared(whole // 2, whole)

    def calibrated(self, base: robot.PlantParams, unknowns: Sequence[Unknown]) -> Calibration:
        """Fit what is `unknowns` of `base` to the log's first half."""
        first, _ = self.halves
        predict = fitting.predictor(replay(self.setup, self.arm, self.controller), base, unknowns, first)
        best = fitting.fit(predict, first.measured, len(unknowns))
        return Calibration(tuple(unknowns), parameters.before(base, unknowns), best)

    def judged(self, part: JointLog, robots: Mapping[str, robot.PlantParams]) -> list[FollowingError]:
        """Following errors on `part` of the log itself, of `robots` by name, and of bare rotors of the first."""
        models = {name: self._replayed(part, params, 1.0) for name, params in robots.items()}
        base = next(iter(robots.values()))
        rotors = replace(base.actuators, coulomb=Vec.full(7, 0.0), bias=Vec.full(7, 0.0))
        models[ROTOR] = self._replayed(part, replace(base, actuators=rotors), 0.0)
        return judgement.following(LOG, part.measured, part.desired[part.cycles], models)

    def _replayed(self, part: JointLog, params: robot.PlantParams, cables: float) -> np.ndarray:
        """[n, 7] joints of one robot where the log was measured; cables 0: all of them cut."""
        run = replay(self.setup, self.arm, self.controller, cables)
        return fitting.predictor(run, params, (), part)(np.zeros((1, 0)))[0]
