"""Fits a robot's parameters to a log of joint positions by the Gauss-Newton method.

A replay simulates the robot and its controller with trial parameters, over long stretches of the
log. A residual is a measured joint position minus the replayed one, divided by the noise. The noise
is the error that remains with the best parameters. Residuals are correlated in time. Each joint's
sum of squares is therefore weighted by its number of independent samples, which follows from the
autocorrelation. Priors are normal distributions; each adds one squared residual. The module also
estimates the covariance of the fitted parameters.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import signal

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
FINEST = 2.0 * transmission.ENCODER_RAD / np.array(transmission.TR)
"""Two counts of the encoder at each joint, rad and m. Whether a motor at rest reads one count more
or less is chance.
"""
ENOUGH = 1e-3  # relative gain below which the fit ends

Predictor = Callable[[np.ndarray], np.ndarray]
"""Maps steps [K, k] (in spreads) to joints [K, n, 7] at the times of measurement; rad and m."""


class Fit(NamedTuple):
    """The most probable parameters, in spreads from their prior, and their covariance."""

    steps: np.ndarray  # [k]
    covariance: np.ndarray  # [k, k]


def fit_parameters(
    predict: Predictor, measured: np.ndarray, unknowns: int, smooth: Predictor | None = None
) -> Fit:
    """Fit by Gauss-Newton with slopes by differences. `measured`: [n, 7], NaN where it is not
    compared.

    `smooth`: predictions without rounding to whole counts, from which slopes are computed; by
    default `predict` itself. If an encoder counts and a motor sticks, chance moves a joint by part
    of a count. A small difference of counted joints would then be mostly chance, and an
    uninformative parameter would seem informative.

    The fit starts at the best of some draws from the prior. At its end it checks larger steps
    along each unknown, because a joint that sticks has no slope.
    """
    there = ~np.isnan(measured)
    smooth = smooth or predict
    probes = DIFFERENCE * np.vstack([np.eye(unknowns), -np.eye(unknowns)])
    # Batches of one size, as many as a slope needs, so that nothing is compiled again.
    rows = max(1 + unknowns, len(CANDIDATES))
    steps, covariance = _start(predict, measured, unknowns, rows), np.eye(unknowns)
    for _ in range(ITERATIONS):
        predicted = predict_in_batches(predict, steps[None], rows)
        residual = np.where(there, measured - predicted[0], 0.0)
        moved = predict_in_batches(smooth, steps + probes, rows)
        slopes = np.where(there, (moved[:unknowns] - moved[unknowns:]) / (2.0 * DIFFERENCE), 0.0)
        weight = _weight(_unexplained(residual, slopes), there)
        slope = (slopes * weight).reshape(unknowns, -1)
        covariance = np.linalg.inv(slope @ slope.T + np.eye(unknowns))
        move = covariance @ (slope @ (residual * weight).ravel() - steps)
        candidates = np.vstack([steps, steps + np.outer(CANDIDATES, move)])
        tried = predict_in_batches(predict, candidates[1:], rows)
        errors = (measured - np.concatenate([predicted, tried])) * weight
        costs = np.nansum(errors**2, axis=(1, 2)) + (candidates**2).sum(axis=1)
        if costs.min() > costs[0] * (1.0 - ENOUGH):
            further = np.concatenate([steps + far * np.eye(unknowns) for far in FURTHER])
            candidates = np.vstack([steps, further])
            costs = _blind(measured, predict_in_batches(predict, candidates, rows), candidates)
            if costs.min() > costs[0] - WORTH:
                break
        steps = candidates[int(np.argmin(costs))]
    return Fit(steps, covariance)


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
    samples = np.random.default_rng(0).standard_normal((SCREENED * rows - 1, unknowns))
    draws = np.vstack([np.zeros(unknowns), 0.7 * samples])
    return draws[int(np.argmin(_blind(measured, predict_in_batches(predict, draws, rows), draws)))]


def predict_in_batches(predict: Predictor, steps: np.ndarray, rows: int) -> np.ndarray:
    """Return predictions for any number of parameters, in batches of `rows`: one compilation."""
    parts = [steps[at : at + rows] for at in range(0, len(steps), rows)]
    filled = [np.vstack([part, np.repeat(part[:1], rows - len(part), axis=0)]) for part in parts]
    return np.concatenate([predict(part) for part in filled])[: len(steps)]


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


def _weight(residual: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return the weight of each residual [n, 7]. With these weights, a joint's sum of squares is
    about its number of independent samples. Its mean square is taken as FINEST or more.
    """
    count = there.sum(axis=0).clip(1)
    scale = np.sqrt((residual**2).sum(axis=0) / count)
    times = np.array(
        [_autocorrelation_time(residual[there[:, j], j]) for j in range(residual.shape[-1])]
    )
    independent = np.maximum(count / times, 1.0)
    return there * np.sqrt(independent / count) / np.maximum(scale, FINEST)


def _autocorrelation_time(series: np.ndarray) -> float:
    """Return the integrated autocorrelation time, in samples, up to the first sign change."""
    if not series.any():
        return 1.0
    correlation = signal.correlate(series, series, method="fft")[len(series) - 1 :]
    end = np.argmax(np.append(correlation, 0.0) <= 0.0)
    return float(1.0 + 2.0 * correlation[1:end].sum() / correlation[0])
