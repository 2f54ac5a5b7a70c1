"""Compiling in a third of the time, for functions of thousands of single numbers that run but a few
thousand times.

XLA spends most of its time on fusing operations. What is not fused gives the same numbers up to
their last bits, some times slower.
"""

from collections.abc import Callable
from typing import Any

import jax

OPTIONS = {"xla_disable_hlo_passes": "fusion"}


def jit(function: Callable[..., Any], **other: Any) -> Callable[..., Any]:
    """`jax.jit`, compiled quickly."""
    return jax.jit(function, compiler_options=OPTIONS, **other)
