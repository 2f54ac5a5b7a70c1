"""Operations of JAX's that take several of the intermediate representation's."""

from __future__ import annotations

from collections.abc import Callable

from ravenjax.ir.builder import Builder


def sign(b: Builder, dtype: str, x: int) -> int:
    """-1, 0 or 1; a zero keeps its sign, NaN stays."""
    zero, one = b.constant(dtype, 0), b.constant(dtype, 1)
    if dtype == "uint32":
        return b.emit("min", dtype, x, one)
    below = b.emit("select", dtype, b.emit("lt", "bool", x, zero), b.constant(dtype, -1), x)
    return b.emit("select", dtype, b.emit("lt", "bool", zero, x), one, below)


def power(b: Builder, dtype: str, x: int, exponent: int) -> int:
    """Repeated squaring, as JAX expands an integer power."""
    result, square = None, x
    for k in range(abs(exponent).bit_length()):
        square = square if k == 0 else b.emit("mul", dtype, square, square)
        if abs(exponent) >> k & 1:
            result = square if result is None else b.emit("mul", dtype, result, square)
    one = b.constant(dtype, 1)
    if result is None:
        return one
    return result if exponent > 0 else b.emit("div", dtype, one, result)


def nearest(b: Builder, length: int, read: Callable[[int], int], index: int) -> int:
    """What `read` gives at `index` (int32) of a table of so many numbers; outside it, at its
    nearest end.
    """
    first, last = b.constant("int32", 0), b.constant("int32", length - 1)
    return read(b.emit("min", "int32", b.emit("max", "int32", index, first), last))
