"""Shorter ways to write an operation on wrapping integers: rules of `simplify`."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from ravenjax.ir.program import ProgramWriter


def operands_of(b: ProgramWriter, i: int, name: str) -> tuple[int, ...] | None:
    """Operands of operation `i` if it has this name."""
    operation = b.operations[i]
    return operation.operands if operation.name == name else None


def neg(b: ProgramWriter, dtype: str, x: int) -> int | None:
    """- - x is x."""
    negated = operands_of(b, x, "neg")
    return negated[0] if negated else None


def _neutral(value: int, absorbing: int | None = None):
    def rule(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
        for p, q in ((x, y), (y, x)):
            constant = b.constants.get(p)
            if constant is not None and int(constant) == value:
                return q
            if constant is not None and absorbing is not None and int(constant) == absorbing:
                return p
        return None

    return rule


def _sub_integer(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    if y in b.constants:
        return b.emit("add", dtype, x, b.emit("neg", dtype, y))
    return b.constant(dtype, 0) if x == y else None


def _add_integer(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    simpler = _neutral(0)(b, dtype, x, y)
    if simpler is not None:
        return simpler
    for p, q in ((x, y), (y, x)):
        inner = operands_of(b, q, "add")
        for constant, rest in permutations(inner) if inner else ():
            if p in b.constants and constant in b.constants:
                return b.emit("add", dtype, b.emit("add", dtype, p, constant), rest)
    return None


def _bits(absorbing: int, neutral: int):
    def rule(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
        if x == y:
            return x
        width = np.dtype(dtype).itemsize * 8
        for p, q in ((x, y), (y, x)):
            constant = b.constants.get(p)
            if constant is not None and int(constant) % 2**width == neutral % 2**width:
                return q
            if constant is not None and int(constant) % 2**width == absorbing % 2**width:
                return p
        return None

    return rule


def _shifted(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    return x if y in b.constants and b.constants[y] == 0 else None


def _shifted_out(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    if y in b.constants and not 0 <= int(b.constants[y]) < np.dtype(dtype).itemsize * 8:
        return b.constant(dtype, 0)
    return _shifted(b, dtype, x, y)


def _extreme_integer(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    return x if x == y else None


RULES = {
    "add": _add_integer,
    "sub": _sub_integer,
    "mul": _neutral(1, 0),
    "and": _bits(0, -1),
    "or": _bits(-1, 0),
    "xor": _neutral(0),
    "neg": neg,
    "shl": _shifted_out,
    "shr": _shifted_out,
    "sar": _shifted,
    "max": _extreme_integer,
    "min": _extreme_integer,
}
