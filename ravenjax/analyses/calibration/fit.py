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

# Step for slopes by central differences, in prior standard deviations.
DIFFERENCE = 0.1
# Fractions of a Gauss-Newton step that are tried in parallel.
CANDIDATES = (1.0, 0.5, 0.2, 0.05)
# Steps along each unknown that are tried if no fraction is better, in prior standard deviations.
FURTHER = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)
ITERATIONS = 40
# Draws from the prior for the first point, as a multiple of the replays that a slope needs.
SCREENED = 3
# Number of independent samples of a joint that is assumed when distant parameters are compared.
# It is low, because the residuals of a poor fit are strongly correlated in time.
ASSUMED_SAMPLES = 10.0
# Decrease of the cost that justifies one of the steps FURTHER.
WORTH = 1.0
MIN_NOISE = 2.0 * transmission.ENCODER_RAD / np.array(transmission.TR)
"""Smallest noise of each joint, rad and m: two encoder counts. A motor at rest varies by one."""
# Relative decrease of the cost below which the fit ends.
ENOUGH = 1e-3

Predictor = Callable[[np.ndarray], np.ndarray]
"""Maps K sets of k parameters [K, k] to joint positions [K, n, 7] at the measured times; rad and m.

Parameters are given as steps from the prior mean, in prior standard deviations.
"""


class Fit(NamedTuple):
    """The most probable parameters and their covariance, in prior standard deviations."""

    steps: np.ndarray  # [k]
    covariance: np.ndarray  # [k, k]


def fit_parameters(
    predict: Predictor, measured: np.ndarray, unknowns: int, smooth: Predictor | None = None
) -> Fit:
    """Return the most probable parameters, by the Gauss-Newton method with slopes by differences.

    `measured`: joint positions [n, 7], rad and m; NaN for values that are not compared. `smooth`:
    a predictor without encoder counts, for slopes; by default `predict` itself. With counts, a
    motor that sticks moves by a count or not, by chance. Small differences would then be mostly
    chance, and a parameter without effect would seem to have one.

    The fit starts at the best of some draws from the prior. At its end it tries larger steps
    along each unknown, because a joint that sticks has no slope.
    """

    def costs_of(sets: np.ndarray) -> np.ndarray:
        # Returns costs of parameter sets [K, k] that are far apart.
        joints = predict_in_batches(predict, sets, rows)
        return _cost_of_unknown_noise(measured, joints, sets)

    is_measured = ~np.isnan(measured)
    smooth = smooth or predict
    probes = DIFFERENCE * np.vstack([np.eye(unknowns), -np.eye(unknowns)])
    # All batches have one size, so that the replay is compiled only once.
    rows = max(1 + unknowns, len(CANDIDATES))
    # The prior of the draws is narrowed to 0.7 standard deviations.
    samples = np.random.default_rng(0).standard_normal((SCREENED * rows - 1, unknowns))
    draws = np.vstack([np.zeros(unknowns), 0.7 * samples])
    steps, covariance = draws[int(np.argmin(costs_of(draws)))], np.eye(unknowns)
    for _ in range(ITERATIONS):
        predicted = predict_in_batches(predict, steps[None], rows)
        residual = np.where(is_measured, measured - predicted[0], 0.0)
        probed = predict_in_batches(smooth, steps + probes, rows)
        differences = (probed[:unknowns] - probed[unknowns:]) / (2.0 * DIFFERENCE)
        slopes = np.where(is_measured, differences, 0.0)
        weight = _weight(_unexplained(residual, slopes), is_measured)
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
            costs = costs_of(candidates)
            if costs.min() > costs[0] - WORTH:
                break
        steps = candidates[int(np.argmin(costs))]
    return Fit(steps, covariance)


def _cost_of_unknown_noise(
    measured: np.ndarray, predicted: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Return the costs [K] of K parameter sets, for noise of unknown size. Parameter sets that are
    far apart can be compared by this cost.

    `measured`: joint positions [n, 7], rad and m; NaN for values that are not compared.
    `predicted`: joint positions of each parameter set [K, n, 7]. `steps`: the parameters [K, k] as
    steps from the prior mean, in prior standard deviations.

    The cost is -2 log(likelihood times prior), without constants. The noise variance of each joint
    is its mean squared residual, which is the most likely value. The likelihood is that of
    ASSUMED_SAMPLES independent samples per joint.
    """
    is_measured = ~np.isnan(measured)
    residual = np.where(is_measured, measured - predicted, 0.0)
    mean_square = (residual**2).sum(axis=1) / is_measured.sum(axis=0).clip(1)
    # The logarithm of a perfect fit is finite, because noise is at least two encoder counts.
    likelihood_cost = ASSUMED_SAMPLES * np.log(mean_square + MIN_NOISE**2).sum(axis=1)
    return likelihood_cost + (steps**2).sum(axis=1)


def predict_in_batches(predict: Predictor, steps: np.ndarray, rows: int) -> np.ndarray:
    """Return predictions for parameter sets. All batches have `rows` rows, for one compilation."""
    parts = [steps[start : start + rows] for start in range(0, len(steps), rows)]
    # Copies of the first row fill the last batch. Their predictions are dropped.
    filled = [np.vstack([part, np.repeat(part[:1], rows - len(part), axis=0)]) for part in parts]
    return np.concatenate([predict(part) for part in filled])[: len(steps)]


def _unexplained(residual: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return the part of the residual [n, 7] that no change of the k parameters removes: the noise.
    `slopes` [k, n, 7]: derivatives of the joint positions. The joints have equal weights. The part
    that a change removes is not noise: later steps of the fit remove it. It is strongly correlated
    in time. If it counted as noise, the fit would stop too early.
    """
    scale = np.maximum(np.sqrt((residual**2).mean(axis=0)), MIN_NOISE)
    columns = (slopes / scale).reshape(len(slopes), -1).T
    step, *_ = np.linalg.lstsq(columns, (residual / scale).ravel(), rcond=1e-6)
    return residual - np.tensordot(step, slopes, axes=1)


def _weight(residual: np.ndarray, is_measured: np.ndarray) -> np.ndarray:
    """Return the weight of each residual [n, 7]. With these weights, a joint's sum of squares is
    about its number of independent samples. The noise is taken as at least MIN_NOISE.
    """
    count = is_measured.sum(axis=0).clip(1)
    scale = np.sqrt((residual**2).sum(axis=0) / count)
    times = np.array(
        [_autocorrelation_time(residual[is_measured[:, j], j]) for j in range(residual.shape[-1])]
    )
    independent = np.maximum(count / times, 1.0)
    # A joint that hardly moves repeats the same few counts, so few samples are independent.
    independent = np.where(scale < MIN_NOISE, np.minimum(independent, ASSUMED_SAMPLES), independent)
    return is_measured * np.sqrt(independent / count) / np.maximum(scale, MIN_NOISE)


def _autocorrelation_time(series: np.ndarray) -> float:
    """Return the integrated autocorrelation time, in samples, up to the first sign change."""
    if not series.any():
        return 1.0
    correlation = signal.correlate(series, series, method="fft")[len(series) - 1 :]
    end = np.argmax(np.append(correlation, 0.0) <= 0.0)
    return float(1.0 + 2.0 * correlation[1:end].sum() / correlation[0])
