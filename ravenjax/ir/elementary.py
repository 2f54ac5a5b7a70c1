"""Elementary functions of real numbers, as this process's C library computes them."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

_LIBRARY = ctypes.CDLL(None)


def _function(name: str, arguments: int) -> Callable[..., float]:
    function = getattr(_LIBRARY, name)
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * arguments
    return function


_UNARY = ["sin", "cos", "tan", "asin", "acos", "atan", "tanh", "exp", "expm1", "log", "log1p"]
FUNCTIONS: dict[str, Callable[..., float]] = {
    **{name: _function(name, 1) for name in _UNARY},
    **{name: _function(name, 2) for name in ("atan2", "fmod", "pow")},
}
"""Functions of Python floats by JAX's names of the operations, except for `fmod`."""
