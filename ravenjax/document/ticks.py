"""Ticks of an axis: round values, and labels with as many decimals as tell neighbours apart."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

MULTIPLES = (1, 2, 2.5, 5, 10)
"""Steps between ticks, times a power of ten."""
DECADES = ((1,), (1, 3), (1, 2, 5))
"""Ticks within a decade, from the coarsest."""
NARROW = "\u202f"


def round_up(width: float) -> float:
    """The least of MULTIPLES times a power of ten that is at least `width`, which is positive."""
    power = 10.0 ** math.floor(math.log10(width))
    return next(m * power for m in MULTIPLES if m * power >= width * (1 - 1e-9))


def round_step(width: float) -> float:
    """The nearest of MULTIPLES times a power of ten, so that bin edges are round numbers; 1 for
    0.
    """
    if width <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(width))
    return min((m * power for m in MULTIPLES), key=lambda step: abs(math.log(step / width)))


def above(value: float, most: int = 5) -> float:
    """The end of an axis from 0 that holds a positive value: the next of at most `most` ticks."""
    step = round_up(value / most)
    return math.ceil(value / step - 1e-9) * step


def linear(low: float, high: float, most: int) -> list[float]:
    """At most `most` (2 or more) multiples of a round step, all within low..high."""
    if not high > low:
        return [low]
    step = round_up((high - low) / most)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def logarithmic(low: float, high: float, most: int) -> list[float]:
    """Round values from low (positive) to high: the finest of DECADES that gives no more than
    `most`, else decades.
    """
    span = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    values: list[float] = []
    for each in DECADES:
        finer = [float(f"{m}e{power}") for power in span for m in each]
        finer = [value for value in finer if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        if len(finer) > most and values:
            break
        values = finer
    return values[:: math.ceil(len(values) / most)] if values else [low]


def labels(values: Sequence[float], share: bool = False) -> list[str]:
    """Words of ticks: 12,000; 0.05; as shares 5 %. Neighbours that differ have different labels."""
    scaled = [100 * value for value in values] if share else list(values)
    unit = f"{NARROW}%" if share else ""
    gaps = [abs(b - a) for a, b in itertools.pairwise(scaled) if b != a]
    even = len(gaps) < 2 or max(gaps) - min(gaps) < 1e-9 * max(gaps)
    if even:
        decimals = _decimals(min(gaps, default=1.0))
        return [_label(value, decimals) + unit for value in scaled]
    return [_label(value, _decimals(value)) + unit for value in scaled]


def _decimals(value: float) -> int:
    """Decimals that write a round number in full."""
    if not value:
        return 0
    digits = f"{abs(value):.3g}"
    text = f"{float(digits):.12f}".rstrip("0")
    return len(text.partition(".")[2])


def _label(value: float, decimals: int) -> str:
    text = f"{value:,.{decimals}f}"
    return ("0" if float(text.replace(",", "")) == 0 else text).replace("-", "−")
