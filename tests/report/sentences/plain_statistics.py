"""Estimates of the report, each from its formula, for tests: none from the package under test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from scipy.stats import binomtest, chi2, norm

Z = float(norm.ppf(0.975))
Bounds = tuple[float, float]
Known = tuple[float, float, float]
"""Estimate and its bounds, NaN where it is not known."""


def wilson(k: int, n: int) -> Bounds:
    """Bounds of a rate (Wilson 1927)."""
    if not n:
        return math.nan, math.nan
    p, shrink = k / n, 1 + Z**2 / n
    middle, half = (
        (p + Z**2 / (2 * n)) / shrink,
        Z / shrink * math.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2)),
    )
    return 0.0 if k == 0 else middle - half, 1.0 if k == n else middle + half


def poisson(count: int, hours: float) -> Known:
    """Events an hour and the exact bounds (Garwood 1936)."""
    low = chi2.ppf(0.025, 2 * count) / 2 / hours if count else 0.0
    return count / hours, float(low), float(chi2.ppf(0.975, 2 * count + 2) / 2 / hours)


def came_by(times: Sequence[int], came: Sequence[bool], share: Fraction) -> Known:
    """When this share of runs had an event (Kaplan-Meier), and when the bounds of the curve reach
    it (Brookmeyer, Crowley 1982); NaN where that is never.

    times: to the event where it came, else as long as the run was watched. Bounds are Greenwood's
    of log(-log), and never fall; before the first event the upper one is that of the first.
    """
    left, variance = Fraction(1), 0.0
    curve: list[tuple[int, Fraction, float, float]] = []
    for ms in sorted(set(times)):
        risk = sum(t >= ms for t in times)
        events = sum(t == ms and c for t, c in zip(times, came, strict=True))
        left *= Fraction(risk - events, risk)
        low, high = 0.0, 1.0
        if 0 < left < 1:
            variance += events / (risk * (risk - events))
            middle, half = math.log(-math.log(left)), Z * math.sqrt(variance) / abs(math.log(left))
            low, high = (
                1 - math.exp(-math.exp(middle - half)),
                1 - math.exp(-math.exp(middle + half)),
            )
        curve.append((ms, 1 - left, low, high))
    if not any(came):
        return math.nan, math.nan, math.nan
    rising = [
        (
            ms,
            value,
            max(low for _, _, low, _ in curve[: i + 1]),
            min(high for *_, high in curve[i:]),
        )
        for i, (ms, value, _, _) in enumerate(curve)
    ]
    value = next((ms for ms, reached, _, _ in rising if reached >= share), math.nan)
    low = next((ms for ms, _, _, high in rising if high >= share), math.nan)
    high = next((ms for ms, _, low, _ in rising if low >= share), math.nan)
    return float(value), float(low), float(high)


def lead(lags: Sequence[int], came: Sequence[bool]) -> Known:
    """Median of how long before the motion the alarm came, of lags alarm minus motion; negative:
    after it.
    """
    value, low, high = came_by(lags, came, Fraction(1, 2))
    return -value, -high, -low


def pair_difference(first: np.ndarray, second: np.ndarray) -> Known:
    """Difference of two rates of pairs (Bonett, Price 2012)."""
    n, only, other = len(first), int((first & ~second).sum()), int((second & ~first).sum())
    p, q = (only + 1) / (n + 2), (other + 1) / (n + 2)
    half = Z * math.sqrt((p + q - (p - q) ** 2) / (n + 2))
    return (only - other) / n, max(-1.0, p - q - half), min(1.0, p - q + half)


def mcnemar(first: np.ndarray, second: np.ndarray) -> float:
    """Chance of so uneven discordant pairs."""
    only, other = int((first & ~second).sum()), int((second & ~first).sum())
    return float(binomtest(only, only + other).pvalue) if only + other else 1.0


def further(p: float, n: int, half: float) -> int:
    """How many more draws make the Wilson interval about a rate as narrow as +- half: by
    bisection.
    """

    def wide(m: int) -> bool:
        return Z * math.sqrt(p * (1 - p) / m + (Z / (2 * m)) ** 2) / (1 + Z**2 / m) > half * (
            1 + 1e-12
        )

    low, high = 1, 10**6
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if wide(middle) else (low, middle)
    return max(0, low - n)


def area(score: np.ndarray, positive: np.ndarray) -> float:
    """Chance that a positive scores higher than a negative, ties half."""
    apart = score[positive][:, None] - score[~positive][None, :]
    return float(((apart > 0) + 0.5 * (apart == 0)).mean())
