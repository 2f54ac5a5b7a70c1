"""What a program means: its operations one by one on NumPy numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from ravenjax.ir import semantics
from ravenjax.ir.lowering import lower
from ravenjax.ir.program import Program, number


def evaluate(
    program: Program, inputs: Sequence[Any], tables: Sequence[np.ndarray] = ()
) -> list[Any]:
    """Results on NumPy numbers or arrays of one shape."""
    values: dict[int, Any] = {}
    for i in program.needed():
        name, dtype, operands, detail = program.operations[i]
        if name == "input":
            values[i] = np.asarray(inputs[detail], dtype)[()]
        elif name == "constant":
            values[i] = number(dtype, detail)
        elif name == "lookup":
            values[i] = tables[detail][values[operands[0]]]
        else:
            values[i] = semantics.evaluate(name, dtype, tuple(values[o] for o in operands))
    return [values[i] for i in program.outputs]


def in_python(function: Callable[..., Any], *shapes: Any) -> Callable[[Sequence[Any]], list[Any]]:
    """`function` one operation at a time, without fusing, as a function of a flat list of
    numbers: in milliseconds what XLA compiles for seconds.
    """
    jaxpr = jax.make_jaxpr(function)(*shapes)
    types = [np.dtype(variable.aval.dtype) for variable in jaxpr.jaxpr.invars]
    run = semantics.compiled(lower(jaxpr, functions="library"))

    def call(numbers: Sequence[Any]) -> list[Any]:
        return run([np.asarray(x).astype(t)[()] for x, t in zip(numbers, types, strict=True)])

    return call
