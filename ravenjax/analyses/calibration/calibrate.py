"""Fits a robot's parameters to the first half of a log, and judges them on the second half."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.calibration import fit as fitting
from ravenjax.analyses.calibration import parameters, position_loop, replays
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.analyses.calibration.parameters import Unknown
from ravenjax.analyses.calibration.position_loop import Controller, LoopParams
from ravenjax.analyses.calibration.replays import ReplaySetup
from ravenjax.errors import UserError
from ravenjax.numbers.vec import replace
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

SETTLING = 1000
"""Cycles at a log's beginning that are not compared: how the cables were loaded there is not
known.
"""
SHORTEST = 4 * SETTLING
"""Cycles of a log that can be fitted to and judged by."""
NORMAL_90 = 1.6449
"""Standard deviations from the middle of a normal distribution to the ends of its middle 90 %."""
CONFOUNDED = 0.7
"""Correlation from which two unknowns count as told together: half of the variance of each is
the other's.
"""
UNLIKELY = 3.0
"""Standard deviations of the belief before: a value farther off says that the robot differs in
more than is asked.
"""
LOG, ROTOR = "the recording", "null: bare rotors"


class FollowingError(NamedTuple):
    """Root mean squares over one part of a log, [7]; rad and m, nan where the log has no such
    joint.
    """

    model: str
    following: np.ndarray  # of measured or replayed minus desired joints
    residual: np.ndarray  # of replayed minus measured joints


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What a log says of a robot."""

    unknowns: tuple[Unknown, ...]
    base: LoopParams  # the robot before
    fit: fitting.Fit

    @property
    def before(self) -> np.ndarray:
        """[k] values before, in their units."""
        return parameters.before(self.base, self.unknowns)

    @property
    def robot(self) -> LoopParams:
        """The most probable one."""
        return parameters.apply(self.base, self.unknowns, self.fit.steps)

    @property
    def after(self) -> np.ndarray:
        """[k] most probable values, in their units."""
        return self._moved(self.fit.steps)

    @property
    def interval(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of the 90 % interval of each, [k], in their units."""
        half = NORMAL_90 * self.told
        return self._moved(self.fit.steps - half), self._moved(self.fit.steps + half)

    @property
    def confounded(self) -> list[tuple[str, str, float]]:
        """Pairs of unknowns that the log tells together rather than each, with the correlation
        that the fit leaves.
        """
        correlation = self.fit.covariance / np.outer(self.told, self.told)
        pairs = zip(*np.triu_indices(len(self.unknowns), 1), strict=True)
        return [
            (self.unknowns[i].path, self.unknowns[j].path, float(correlation[i, j]))
            for i, j in pairs
            if abs(correlation[i, j]) >= CONFOUNDED
        ]

    @property
    def unlikely(self) -> list[tuple[str, float]]:
        """Unknowns that the fit moved by UNLIKELY or more, with how far, in standard deviations
        of the belief.
        """
        rows = zip(self.unknowns, self.fit.steps.tolist(), strict=True)
        return [(one.path, steps) for one, steps in rows if abs(steps) >= UNLIKELY]

    def draws(self, number: int, seed: int = 0) -> np.ndarray:
        """[number, k] robots that the log leaves likely, in spreads from the values before."""
        return np.random.default_rng(seed).multivariate_normal(
            self.fit.steps, self.fit.covariance, number
        )

    @property
    def told(self) -> np.ndarray:
        """Standard deviation after the log by that before it, [k]: 1 where the log tells
        nothing.
        """
        return np.sqrt(np.diag(self.fit.covariance))

    def _moved(self, steps: np.ndarray) -> np.ndarray:
        values = (
            parameters.moved_by(self.before[k], one, steps[k])
            for k, one in enumerate(self.unknowns)
        )
        return np.array([float(value) for value in values])


@dataclasses.dataclass(frozen=True)
class LoggedRobot:
    """A log with the robot that it is of: which arm, how its software strings the tool, which
    controller.
    """

    log: JointLog
    setup: RavenSetup
    arm: ArmName
    controller: Controller

    @property
    def halves(self) -> tuple[JointLog, JointLog]:
        """What is fitted to, and what is kept back; both are replayed from the log's beginning."""
        whole = len(self.log.desired)
        return self.log.compared(SETTLING, whole // 2), self.log.compared(whole // 2, whole)

    def calibrated(self, plant: robot.PlantParams, unknowns: Sequence[Unknown]) -> Calibration:
        """Fit `unknowns` of a robot to the log's first half. UserError where the log is too
        short.
        """
        if len(self.log.desired) < SHORTEST:
            raise UserError(
                f"the log lasts {len(self.log.desired) * 1e-3:.3g} s, expected at least"
                f" {SHORTEST * 1e-3:g} s, half of it to fit to and half to judge by"
            )
        first, _ = self.halves
        base = parameters.believed(plant, unknowns)
        setup = self._setup(unknowns)
        predict, smooth = (
            replays.predictor(dataclasses.replace(setup, whole=whole), base, unknowns, first)
            for whole in (True, False)
        )
        best = fitting.fit(predict, first.measured, len(unknowns), smooth)
        return Calibration(tuple(unknowns), base, best)

    def judged(self, part: JointLog, robots: Mapping[str, LoopParams]) -> list[FollowingError]:
        """Following errors on `part` of the log itself, of `robots` by name, and of bare rotors
        of the first.
        """
        first = next(iter(robots.values()))
        rotors = replace(position_loop.params(position_loop.bare_rotors(first.plant)), cables=0.0)
        joints = self.replayed(part, [*robots.values(), rotors])
        desired, there = part.desired[part.cycles], ~np.isnan(part.measured)

        def rms(errors: np.ndarray) -> np.ndarray:
            count = there.sum(axis=0)
            total = np.square(np.where(there, errors, 0.0)).sum(axis=0)
            return np.sqrt(np.where(count > 0, total / count.clip(1), np.nan))

        return [
            FollowingError(model, rms(shown - desired), rms(shown - part.measured))
            for model, shown in zip((LOG, *robots, ROTOR), (part.measured, *joints), strict=True)
        ]

    def replayed(self, part: JointLog, robots: Sequence[LoopParams]) -> np.ndarray:
        """[K, n, 7] joints of robots where the log was measured, rad and m."""
        return replays.robots(self._setup(parameters.unknowns((), ("delays",))), robots, part)

    def _setup(self, unknowns: Sequence[Unknown]) -> ReplaySetup:
        return replays.setup_of(self.setup, self.arm, self.controller, unknowns)
