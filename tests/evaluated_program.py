"""What a function means: its operations one by one on NumPy numbers."""

from collections.abc import Callable, Sequence
from typing import Any

import jax

from ravenjax.ir import semantics
from ravenjax.ir.lowering import lower_jaxpr


def in_python(function: Callable[..., Any], *shapes: Any) -> Callable[[Sequence[Any]], list[Any]]:
    """`function` one operation at a time, without fusing, as a function of a flat list of
    numbers: in milliseconds what XLA compiles for seconds.
    """
    program = lower_jaxpr(jax.make_jaxpr(function)(*shapes), functions="library")
    return lambda numbers: semantics.run_program(program, numbers)
