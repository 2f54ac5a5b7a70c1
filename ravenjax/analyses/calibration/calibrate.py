"""Fits parameters to a log's first half, and measures the prediction error on the second half."""

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
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

SETTLING = 1000
"""Number of first cycles (1 ms) of a log that are not compared: cable loads are unknown."""
SHORTEST = 4 * SETTLING
"""Smallest number of cycles of a log that can be used for a fit and its test."""
NORMAL_90 = 1.6449
"""Standard deviations from the mean of a normal distribution to the ends of its middle 90 %."""
CONFOUNDED = 0.7
"""Correlation from which two parameters count as confounded: they share half of their variance."""
UNLIKELY = 3.0
"""Standard deviations of the prior. If a fitted value is farther from the prior mean, the robot
probably also differs in something that is not estimated.
"""
LOG, ROTOR = "the recording", "null: bare rotors"


class FollowingError(NamedTuple):
    """Root mean square errors [7] over one part of a log; rad and m, NaN for joints not logged."""

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
        """Return the values of the unknowns before calibration [k], in their units."""
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
        half = NORMAL_90 * self.spread_ratio
        return self._moved(self.fit.steps - half), self._moved(self.fit.steps + half)

    @property
    def confounded(self) -> list[tuple[str, str, float]]:
        """Return pairs of unknowns that the log determines only jointly, with their correlation."""
        # spread_ratio is the square root of the covariance's diagonal.
        correlation = self.fit.covariance / np.outer(self.spread_ratio, self.spread_ratio)
        return [
            (self.unknowns[i].path, self.unknowns[j].path, float(correlation[i, j]))
            for i, j in zip(*np.triu_indices(len(self.unknowns), 1), strict=True)
            if abs(correlation[i, j]) >= CONFOUNDED
        ]

    @property
    def unlikely(self) -> list[tuple[str, float]]:
        """Return (parameter, shift) of shifts of at least UNLIKELY prior standard deviations."""
        rows = zip(self.unknowns, self.fit.steps.tolist(), strict=True)
        return [(one.path, steps) for one, steps in rows if abs(steps) >= UNLIKELY]

    def draws(self, number: int) -> np.ndarray:
        """Return random robots [number, k] from the fit, as steps in prior standard deviations."""
        return np.random.default_rng(0).multivariate_normal(
            self.fit.steps, self.fit.covariance, number
        )

    @property
    def spread_ratio(self) -> np.ndarray:
        """Return each posterior standard deviation [k] divided by the prior one.

        It is 1 if the log did not determine the parameter.
        """
        return np.sqrt(np.diag(self.fit.covariance))

    def _moved(self, steps: np.ndarray) -> np.ndarray:
        # Returns the values of the unknowns after `steps`, in prior standard deviations.
        moved = parameters.apply_steps(self.base, self.unknowns, steps)
        return parameters.prior_values(moved, self.unknowns)


@dataclasses.dataclass(frozen=True)
class LoggedRobot:
    """A log, and the properties of its robot: arm, tool, controller, and software."""

    log: JointLog
    setup: RavenSetup
    arm: ArmName
    controller: Controller

    @property
    def halves(self) -> tuple[JointLog, JointLog]:
        """Return the parts for fit and test. Replays of both start at the beginning of the log."""
        whole = len(self.log.desired)
        return self.log.compared(SETTLING, whole // 2), self.log.compared(whole // 2, whole)

    @property
    def at_rest(self) -> list[str]:
        """Return the joints that move by at most two encoder counts in the part for the fit."""
        first, _ = self.halves
        # Rows that are not compared have only NaN.
        positions = first.measured[~np.isnan(first.measured).all(axis=1)]
        travel = np.ptp(positions, axis=0)
        return [JOINTS[j] for j in self.log.joints if travel[j] <= fitting.MIN_NOISE[j]]

    def calibrated(self, plant: robot.PlantParams, unknowns: Sequence[Unknown]) -> Calibration:
        """Fit `unknowns` to the log's first half. Raises UserError for a short log or no motion."""
        if len(self.log.desired) < SHORTEST:
            raise UserError(
                f"the log lasts {len(self.log.desired) * 1e-3:.3g} s, expected at least"
                f" {SHORTEST * 1e-3:g} s: one half for the fit and one half to test the fit"
            )
        first, _ = self.halves
        if len(self.at_rest) == len(self.log.joints):
            raise UserError(
                f"no joint moves in the first half of the log ({', '.join(self.at_rest)}), so the"
                " log determines no parameter. Log a motion of all joints"
            )
        base = parameters.prior_robot(plant, unknowns)
        setup = self._setup(unknowns)
        predict = replays.make_predictor(setup, base, unknowns, first)
        # Encoders and DAC round to whole counts, which hides the effect of a small change of a
        # parameter. The fit therefore computes derivatives from replays without rounding.
        unrounded = dataclasses.replace(setup, whole_counts=False)
        predict_unrounded = replays.make_predictor(unrounded, base, unknowns, first)
        best = fitting.fit_parameters(predict, first.measured, len(unknowns), predict_unrounded)
        return Calibration(tuple(unknowns), base, best)

    def following_errors(
        self, part: JointLog, robots: Mapping[str, LoopParams]
    ) -> list[FollowingError]:
        """Return the errors on `part` of the log: of the logged robot, of replays of `robots` (by
        name), and of a replay of the null model, whose motors are not connected to the arm.
        """
        first_robot = next(iter(robots.values()))
        bare_rotors = position_loop.bare_rotors(first_robot.plant)
        null_model = replace(position_loop.params(bare_rotors), cables=0.0)
        motions = self.replay(part, [*robots.values(), null_model])
        desired, measured = part.desired[part.cycles], part.measured

        def rms(errors: np.ndarray) -> np.ndarray:
            squares = np.ma.masked_array(np.square(errors), np.isnan(measured))
            return np.sqrt(squares.mean(axis=0).filled(np.nan))

        return [
            FollowingError(model, following=rms(motion - desired), residual=rms(motion - measured))
            for model, motion in zip((LOG, *robots, ROTOR), (measured, *motions), strict=True)
        ]

    def replay(self, part: JointLog, robots: Sequence[LoopParams]) -> np.ndarray:
        """Return joint positions of replays [robots, samples, 7] at the log's times, rad and m."""
        # The setup simulates delays only if they are unknowns. These robots may have delays.
        delays = parameters.select_unknowns(joints=(), asks=("delays",))
        return replays.replay_robots(self._setup(delays), robots, part)

    def _setup(self, unknowns: Sequence[Unknown]) -> ReplaySetup:
        return replays.setup_of(self.setup, self.arm, self.controller, unknowns)
