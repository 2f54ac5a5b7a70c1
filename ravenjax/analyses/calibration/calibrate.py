"""Fits a robot's parameters to the first half of a log, and measures the prediction error on the
second half."""

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
"""Cycles at a log's beginning that are not compared, because the initial load of the cables is
unknown.
"""
SHORTEST = 4 * SETTLING
"""Fewest cycles of a log that can be fitted to and judged by."""
NORMAL_90 = 1.6449
"""Standard deviations from the mean of a normal distribution to the ends of its middle 90 %."""
CONFOUNDED = 0.7
"""Correlation from which two unknowns count as confounded: half of the variance of each is shared.
"""
UNLIKELY = 3.0
"""Standard deviations of the prior. A value farther off suggests that the robot also differs
in something that is not estimated.
"""
LOG, ROTOR = "the recording", "null: bare rotors"


class FollowingError(NamedTuple):
    """Root mean squares over one part of a log, [7]; rad and m, NaN for joints the log lacks."""

    model: str
    following: np.ndarray  # measured or replayed minus desired joints
    residual: np.ndarray  # replayed minus measured joints


@dataclasses.dataclass(frozen=True)
class Calibration:
    """The result of a calibration: what a log shows about a robot."""

    unknowns: tuple[Unknown, ...]
    base: LoopParams  # the robot before calibration
    fit: fitting.Fit

    @property
    def before(self) -> np.ndarray:
        """Return the values before calibration [k], in their units."""
        return parameters.prior_values(self.base, self.unknowns)

    @property
    def robot(self) -> LoopParams:
        """Return the most probable robot."""
        return parameters.apply_steps(self.base, self.unknowns, self.fit.steps)

    @property
    def after(self) -> np.ndarray:
        """Return the most probable values [k], in their units."""
        return self._moved(self.fit.steps)

    @property
    def interval(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the ends of each 90 % interval, [k], in their units."""
        half = NORMAL_90 * self.told
        return self._moved(self.fit.steps - half), self._moved(self.fit.steps + half)

    @property
    def confounded(self) -> list[tuple[str, str, float]]:
        """Return pairs of unknowns that the log determines only jointly, with their correlation."""
        correlation = self.fit.covariance / np.outer(self.told, self.told)
        pairs = zip(*np.triu_indices(len(self.unknowns), 1), strict=True)
        return [
            (self.unknowns[i].path, self.unknowns[j].path, float(correlation[i, j]))
            for i, j in pairs
            if abs(correlation[i, j]) >= CONFOUNDED
        ]

    @property
    def unlikely(self) -> list[tuple[str, float]]:
        """Return (parameter, shift) where the shift is at least UNLIKELY prior deviations."""
        rows = zip(self.unknowns, self.fit.steps.tolist(), strict=True)
        return [(one.path, steps) for one, steps in rows if abs(steps) >= UNLIKELY]

    def draws(self, number: int) -> np.ndarray:
        """Return [number, k] robots that the log leaves likely, in spreads from their prior."""
        return np.random.default_rng(0).multivariate_normal(
            self.fit.steps, self.fit.covariance, number
        )

    @property
    def told(self) -> np.ndarray:
        """Return posterior over prior standard deviations; 1: the log determined nothing."""
        return np.sqrt(np.diag(self.fit.covariance))

    def _moved(self, steps: np.ndarray) -> np.ndarray:
        values = (
            parameters.moved_by(self.before[k], one, steps[k])
            for k, one in enumerate(self.unknowns)
        )
        return np.array([float(value) for value in values])


@dataclasses.dataclass(frozen=True)
class LoggedRobot:
    """A log and its robot: arm, controller, and the software's assumption about tool cables."""

    log: JointLog
    setup: RavenSetup
    arm: ArmName
    controller: Controller

    @property
    def halves(self) -> tuple[JointLog, JointLog]:
        """Return the fitted and the held-back part. Both are replayed from the log's beginning."""
        whole = len(self.log.desired)
        return self.log.compared(SETTLING, whole // 2), self.log.compared(whole // 2, whole)

    def calibrated(self, plant: robot.PlantParams, unknowns: Sequence[Unknown]) -> Calibration:
        """Fit `unknowns` to the log's first half. Raises UserError if the log is too short."""
        if len(self.log.desired) < SHORTEST:
            raise UserError(
                f"the log lasts {len(self.log.desired) * 1e-3:.3g} s, expected at least"
                f" {SHORTEST * 1e-3:g} s, one half for the fit and one for the comparison"
            )
        first, _ = self.halves
        base = parameters.prior_robot(plant, unknowns)
        setup = self._setup(unknowns)
        predict, smooth = (
            replays.make_predictor(dataclasses.replace(setup, whole=whole), base, unknowns, first)
            for whole in (True, False)
        )
        best = fitting.fit_parameters(predict, first.measured, len(unknowns), smooth)
        return Calibration(tuple(unknowns), base, best)

    def judged(self, part: JointLog, robots: Mapping[str, LoopParams]) -> list[FollowingError]:
        """Return following errors on `part`: of the log, of `robots` by name, of bare rotors."""
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
        """Return joints [K, n, 7] of replayed robots at the times of the log's samples, rad, m."""
        return replays.replay_robots(
            self._setup(parameters.select_unknowns((), ("delays",))), robots, part
        )

    def _setup(self, unknowns: Sequence[Unknown]) -> ReplaySetup:
        return replays.setup_of(self.setup, self.arm, self.controller, unknowns)
