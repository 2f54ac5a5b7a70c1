"""Functions of real numbers as the C library has them, with IEEE's answer where Python raises."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any


def guarded(
    function: Callable[..., float], otherwise: Callable[..., float]
) -> Callable[..., float]:
    """`function`, and `otherwise` of the arguments that it refuses."""

    def total(*x: Any) -> float:
        try:
            return function(*x)
        except (ValueError, OverflowError):
            return otherwise(*x)

    return total


def _nan(*x: Any) -> float:
    return math.nan


def _infinite(*x: Any) -> float:
    return math.inf


def _pow(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except OverflowError:
        return -math.inf if a < 0 and b % 2 == 1 else math.inf
    except ValueError:
        return math.copysign(math.inf, a if b % 2 == 1 else 1.0) if a == 0 else math.nan


FUNCTIONS: dict[str, Callable[..., float]] = {
    **{name: guarded(getattr(math, name), _nan) for name in ("sin", "cos", "tan", "asin", "acos")},
    **{name: getattr(math, name) for name in ("atan", "atan2", "tanh")},
    **{name: guarded(getattr(math, name), _infinite) for name in ("exp", "expm1")},
    "log": guarded(math.log, lambda x: -math.inf if x == 0 else math.nan),
    "log1p": guarded(math.log1p, lambda x: -math.inf if x == -1 else math.nan),
    "fmod": guarded(math.fmod, _nan),
    "pow": _pow,
}
"""By the name of the operation, which is JAX's but for `fmod`; of Python floats."""
