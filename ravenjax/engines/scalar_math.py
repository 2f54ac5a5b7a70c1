"""Operations on single numbers where Python would raise and IEEE arithmetic has an answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

_isfinite = math.isfinite
_atan2 = math.atan2
_atan = math.atan
_tanh = math.tanh


def _guarded(function: Callable[[Any], float], otherwise: Callable[[Any], float]) -> Callable[[Any], float]:
    """`function`, and `otherwise` of the arguments that it refuses."""

    def guarded(x: Any) -> float:
        try:
            return function(x)
        except (ValueError, OverflowError):
            return otherwise(x)

    return guarded


def _nan(x: Any) -> float:
    return math.nan


_sin, _cos, _tan = (_guarded(function, _nan) for function in (math.sin, math.cos, math.tan))
_asin, _acos, _sqrt = (_guarded(function, _nan) for function in (math.asin, math.acos, math.sqrt))
_exp = _guarded(math.exp, lambda x: math.inf)
_expm1 = _guarded(math.expm1, lambda x: math.inf)
_log = _guarded(math.log, lambda x: -math.inf if x == 0 else math.nan)
_log1p = _guarded(math.log1p, lambda x: -math.inf if x == -1 else math.nan)


def _unchanged(x: Any) -> float:
    return float(x)


_floor = _guarded(lambda x: math.copysign(float(math.floor(x)), x), _unchanged)
_ceil = _guarded(lambda x: math.copysign(float(math.ceil(x)), x), _unchanged)
_round = _guarded(lambda x: math.copysign(float(round(float(x))), x), _unchanged)


def _sign(x: float) -> float:
    return x if x == 0 or x != x else math.copysign(1.0, x)


def _div(a: float, b: float) -> float:
    try:
        return a / b
    except ZeroDivisionError:
        if a == 0 or a != a:
            return math.nan
        return math.copysign(math.inf, a) * math.copysign(1.0, b)


def _rem(a: float, b: float) -> float:
    try:
        return math.fmod(a, b)
    except ValueError:
        return math.nan


def _pow(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except OverflowError:
        return math.inf
    except ValueError:
        return math.inf if a == 0 else math.nan


def _quotient(a: int, b: int) -> int:
    """Integer division toward zero; -1 where b is 0, as XLA has it."""
    if b == 0:
        return -1
    quotient = abs(a) // abs(b)
    return quotient if (a < 0) == (b < 0) else -quotient


def _wrap(x: int, bits: int, signed: bool) -> int:
    """An integer modulo 2^bits, as a number of that width."""
    x &= (1 << bits) - 1
    return x - (1 << bits) if signed and x >> (bits - 1) else x


def _to_integer(x: float, bits: int, signed: bool) -> int:
    """Truncation toward zero; 0 for NaN and the nearest end for what does not fit, as XLA has it."""
    if x != x:
        return 0
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    return int(min(max(x, low), high))
