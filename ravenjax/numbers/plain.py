"""The functions that the tick's code calls, in NumPy: for plain numbers, each result of the type
JAX would give it.

Results are those of XLA on a CPU, bit for bit, but for sine and cosine of float32: those here are
correctly rounded.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np


class Numpy:
    """`jax.numpy` of plain numbers: NumPy's own functions, single numbers out."""

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    @staticmethod
    def sin(x: Any) -> Any:
        """Sine."""
        return _of_type(x)(math.sin(x))

    @staticmethod
    def cos(x: Any) -> Any:
        """Cosine."""
        return _of_type(x)(math.cos(x))

    @staticmethod
    def where(condition: Any, yes: Any, no: Any) -> Any:
        """`yes` or `no`, in the type that both share."""
        return np.where(condition, yes, no)[()]


class Lax:
    """`jax.lax` of plain numbers."""

    @staticmethod
    def convert_element_type(x: Any, dtype: Any) -> Any:
        """`x` as a number of that type."""
        return np.asarray(x).astype(dtype)[()]


def _of_type(x: Any) -> Any:
    return type(x) if isinstance(x, np.floating) else float
