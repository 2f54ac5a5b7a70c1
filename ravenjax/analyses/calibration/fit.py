"""Fits parameters to a log by Gauss-Newton on long stretches of closed loop, and estimates their
covariance.

The residual is measured minus replayed joints, scaled by the part of it that no step can remove.
This residual is correlated in time. So each joint's squares count only for its number of
independent samples, by the integrated autocorrelation time. Beliefs before the log are normal, and
each enters as one more squared residual.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from ravenjax.analyses.calibration.position_loop import JOINTS
from ravenjax.robots.raven2.geometry import transmission

# Spreads, to both sides. The interaction of two parameters is a small difference of their separate
# effects.
DIFFERENCE = 0.1
CANDIDATES = (1.0, 0.5, 0.2, 0.05)  # of a Gauss-Newton step, tried side by side
# Spreads along each unknown, tried if no step is better.
FURTHER = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)
ITERATIONS = 40
SCREENED = 3  # draws, as a multiple of the replays of a slope
LEAST = 10.0  # least number of independent samples of a joint
WORTH = 1.0  # gain of a longer step, in squares
FINEST = 2.0 * transmission.ENCODER_RAD / np.array([*transmission.TR])
"""Two counts of the encoder at each joint, rad and m. Whether a motor at rest reads one count more
or less is chance.
"""
ENOUGH = 1e-3  # relative gain below which the fit ends

Predictor = Callable[[np.ndarray], np.ndarray]
"""Maps steps [K, k] (in spreads) to joints [K, n, 7] at the times of measurement; rad and m."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """The most probable parameters, in spreads from their values before, and the covariance around
    them.
    """

    steps: np.ndarray  # [k]
    covariance: np.ndarray  # [k, k]
    # [7] root mean square of each joint's residual, at least FINEST; rad and m.
    scale: np.ndarray
    independent: np.ndarray  # [7] number of independent samples of each joint's residual
    costs: tuple[
        tuple[float, float], ...
    ]  # Costs before and after each iteration, both in the same weights.

    def weight(self, measured: np.ndarray) -> np.ndarray:
        """Return the weight of each residual [n, 7], chosen so that a joint's squares add up to its
        number of independent samples.
        """
        there = ~np.isnan(measured)
        return np.where(
            there, np.sqrt(self.independent / there.sum(axis=0).clip(1)) / self.scale, 0.0
        )


def fit_parameters(
    predict: Predictor, measured: np.ndarray, unknowns: int, smooth: Predictor | None = None
) -> Fit:
    """Fit by Gauss-Newton with slopes by differences. `measured`: [n, 7], NaN where it is not
    compared.

    `smooth`: predictions without rounding to whole counts, from which slopes are computed; by
    default `predict` itself. If an encoder counts and a motor sticks, chance moves a joint by part
    of a count. A small difference of counted joints would then be mostly chance, and an
    uninformative parameter would seem informative.

    The fit starts at the best of some draws from the beliefs. At its end it checks larger steps
    along each unknown, because a joint that sticks has no slope.
    """
    there = ~np.isnan(measured)
    smooth = smooth or predict
    probes = DIFFERENCE * np.vstack([np.eye(unknowns), -np.eye(unknowns)])
    count = replays_per_batch(unknowns)
    best = Fit(
        _start(predict, measured, unknowns, count),
        np.eye(unknowns),
        np.ones(JOINTS),
        np.ones(JOINTS),
        (),
    )
    for _ in range(ITERATIONS):
        predicted = predict_in_batches(predict, best.steps[None], count)
        residual = np.where(there, measured - predicted[0], 0.0)
        moved = predict_in_batches(smooth, best.steps + probes, count)
        slopes = np.where(there, (moved[:unknowns] - moved[unknowns:]) / (2.0 * DIFFERENCE), 0.0)
        scale, independent = _noise(_unexplained(residual, slopes), there)
        best = dataclasses.replace(best, scale=scale, independent=independent)
        slope = (slopes * best.weight(measured)).reshape(unknowns, -1)
        covariance = np.linalg.inv(slope @ slope.T + np.eye(unknowns))
        move = covariance @ (slope @ (residual * best.weight(measured)).ravel() - best.steps)
        best = dataclasses.replace(best, covariance=covariance)
        before = compute_costs(best, measured, predicted, best.steps[None])[0]
        candidates = best.steps + np.outer(CANDIDATES, move)
        after = compute_costs(
            best, measured, predict_in_batches(predict, candidates, count), candidates
        )
        best = dataclasses.replace(
            best, costs=(*best.costs, (before, float(min(before, after.min()))))
        )
        if after.min() > before * (1.0 - ENOUGH):
            further = np.concatenate([best.steps + far * np.eye(unknowns) for far in FURTHER])
            candidates = np.vstack([best.steps, further])
            after = _blind(measured, predict_in_batches(predict, candidates, count), candidates)
            if after.min() > after[0] - WORTH:
                break
        best = dataclasses.replace(best, steps=candidates[int(np.argmin(after))])
    return best


def replays_per_batch(unknowns: int) -> int:
    """Return the number of replays that run side by side: as many as a slope needs."""
    return max(1 + unknowns, len(CANDIDATES))


def compute_costs(
    at: Fit, measured: np.ndarray, predicted: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Return the costs of predictions [K, n, 7] and their steps [K, k], in the weights of `at`."""
    weight = at.weight(measured)
    return np.array(
        [
            sum_squares(measured, joints, weight) + one @ one
            for joints, one in zip(predicted, steps, strict=True)
        ]
    )


def _blind(measured: np.ndarray, predicted: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the costs of predictions [K, n, 7] while the noise is unknown: each joint's whole
    residual counts as noise.

    The cost is -2 log likelihood of LEAST independent samples per joint, so that distant parameters
    can be compared.
    """
    there = ~np.isnan(measured)
    errors = np.where(there, measured - predicted, 0.0)
    mean = (errors**2).sum(axis=1) / there.sum(axis=0).clip(1)
    return LEAST * np.log(mean + FINEST**2).sum(axis=1) + (steps**2).sum(axis=1)


def _start(predict: Predictor, measured: np.ndarray, unknowns: int, rows: int) -> np.ndarray:
    """Return the best of the prior values and of some draws from narrowed beliefs."""
    samples = np.random.default_rng(0).standard_normal((SCREENED * rows - 1, unknowns))
    draws = np.vstack([np.zeros(unknowns), 0.7 * samples])
    return draws[int(np.argmin(_blind(measured, predict_in_batches(predict, draws, rows), draws)))]


def predict_in_batches(predict: Predictor, steps: np.ndarray, rows: int) -> np.ndarray:
    """Return predictions for any number of parameters, computed in batches of `rows`, so that
    nothing is compiled again.
    """
    parts = [steps[at : at + rows] for at in range(0, len(steps), rows)]
    filled = [np.vstack([part, np.repeat(part[:1], rows - len(part), axis=0)]) for part in parts]
    return np.concatenate([predict(part) for part in filled])[: len(steps)]


def sum_squares(measured: np.ndarray, joints: np.ndarray, weight: np.ndarray) -> float:
    """Return the sum of weighted squares of measured minus replayed joints [n, 7]. NaN is not
    compared.
    """
    return float((np.where(weight > 0.0, measured - joints, 0.0) ** 2 * weight**2).sum())


def _unexplained(residual: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return the part of the residual [n, 7] that no step of the unknowns removes, with equal
    weight on each joint: the noise of the fit.

    The removable part is still to be fitted. It is strongly correlated, so if it counted as noise,
    it would keep the fit from moving.
    """
    unit = np.maximum(np.sqrt((residual**2).mean(axis=0)), FINEST)
    columns = (slopes / unit).reshape(len(slopes), -1).T
    step, *_ = np.linalg.lstsq(columns, (residual / unit).ravel(), rcond=1e-6)
    return residual - np.tensordot(step, slopes, axes=1)


def _noise(residual: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the root mean square of each joint's residual, at least FINEST, and its number of
    independent samples; [7] each.
    """
    count = there.sum(axis=0)
    scale = np.sqrt((residual**2).sum(axis=0) / count.clip(1))
    times = np.array(
        [_autocorrelation_time(residual[there[:, j], j]) for j in range(residual.shape[-1])]
    )
    return np.maximum(scale, FINEST), np.maximum(count / times, 1.0)


def _autocorrelation_time(series: np.ndarray) -> float:
    """Return the integrated autocorrelation time of [n], in samples, summed up to the first sign
    change.
    """
    spectrum = np.abs(np.fft.rfft(series, 2 * len(series))) ** 2 if len(series) else np.zeros(1)
    correlation = (
        np.fft.irfft(spectrum, 2 * len(series))[: len(series)] if len(series) else np.zeros(1)
    )
    if correlation[0] <= 0.0:
        return 1.0
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation <= 0.0)
    end = int(below[0]) if len(below) else len(correlation)
    return float(1.0 + 2.0 * correlation[1:end].sum())
