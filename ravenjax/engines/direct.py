"""Traces the tick of one robot without JAX: run on numbers that write down what is done with them.

The programs are those that `tracing` gets through JAX, operation by operation, in a fifth of the
time and without its import.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.engines.interface import Block, TickProgram
from ravenjax.engines.tick_functions import TickFunctions
from ravenjax.engines.traced_tick import TracedTick
from ravenjax.ir import traced_number
from ravenjax.ir.builder import Builder, contract
from ravenjax.ir.program import Program
from ravenjax.ir.time_loop import TimeLoop
from ravenjax.ir.traced_functions import TracedLax, TracedNumpy
from ravenjax.ir.traced_number import DTYPES, TracedNumber, TracedTable, Untraceable
from ravenjax.numbers import tree
from ravenjax.numbers.lazy import instead

__all__ = ["Untraceable", "trace"]


def trace(program: TickProgram, block: Block, motion: Sequence[Any]) -> TracedTick:
    """See `traced.trace`. Raises Untraceable for what only JAX knows."""
    if program.setup.precision.needs_x64:
        raise traced_number.refused("arithmetic of 64 bits")
    functions = TickFunctions(program)
    lane = tree.mapped(traced_number.kind_of, tuple(functions.lane_types(block)))
    first, state = written(functions.begin, lane)
    kinds = tree.mapped(kind, state)
    of_tick = (
        traced_number.INT,
        [traced_number.FLOAT] * functions.series,
        tuple(map(ColumnInput, motion)),
    )
    middle, (_, _, signals) = written(functions.step, (*lane, kinds, *of_tick))
    last, outcomes = written(functions.finish, (*lane, kinds))
    dtypes = tree.mapped(lambda leaf: np.dtype(DTYPES[kind(leaf)]), signals)
    return TracedTick(
        TimeLoop(first, middle, last), tuple(sorted(outcomes)), functions.series, dtypes
    )


class ColumnInput:
    """A column of the motion among the inputs."""

    def __init__(self, column: Any) -> None:
        if len(column.shape) != 1:
            raise traced_number.refused(f"a table of shape {column.shape}")
        self.dtype, self.length = str(column.dtype), column.shape[0]


def kind(leaf: Any) -> int:
    """What a number of a traced function's result is."""
    return traced_number.plain_kind(leaf)


def written(function: Callable[..., Any], inputs: tuple[Any, ...]) -> tuple[Program, Any]:
    """The program of a function of numbers of these kinds and of these columns, and what it
    returned.

    The function takes `jnp` and `lax` from `numbers.lazy`. Raises Untraceable.
    """
    builder = Builder()

    def number(of: Any) -> Any:
        if isinstance(of, ColumnInput):
            return TracedTable(builder, of.dtype, of.length)
        return TracedNumber(builder, builder.input(DTYPES[of]), of)

    with instead(TracedNumpy(builder), TracedLax(builder)):
        result = function(*tree.mapped(number, inputs))
        outputs = [traced_number.operand(builder, leaf).index for leaf in tree.leaves(result)]
    return contract(builder.program(outputs)), result
