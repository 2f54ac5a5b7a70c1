"""Stages of the control software as the package's printed Python: in milliseconds what XLA
compiles for seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from evaluated_program import in_python


def printed(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` of trees of single numbers, traced and printed once for each structure and
    width of its arguments.
    """
    kept: dict[Any, Any] = {}

    def call(*arguments: Any) -> Any:
        numbers, structure = jax.tree.flatten(arguments)
        key = structure, tuple(jax.typeof(number) for number in numbers), jax.config.jax_enable_x64
        if key not in kept:
            shape = jax.eval_shape(function, *arguments)
            kept[key] = in_python(function, *arguments), jax.tree.structure(shape)
        code, result = kept[key]
        return jax.tree.unflatten(result, code(numbers))

    return call
