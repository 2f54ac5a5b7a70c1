"""Shorter ways to write an operation that give the same bits for every operand.

Only the payload of a NaN may differ. Integers wrap.
"""

from __future__ import annotations

import math
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


FLOATS = ("float32", "float64")
_COMPARISONS = ("eq", "ne", "lt", "le")


def simplify(b: ProgramWriter, name: str, dtype: str, operands: tuple[int, ...]) -> int | None:
    """The number of a simpler result that equals the operation's; None where there is none."""
    if name in _COMPARISONS:
        return _comparison(b, name, operands)
    if name == "select":
        return _choice(b, dtype, *operands)
    if name == "rarely":
        return _rare_choice(b, *operands)
    if name in ("convert", "bitcast"):
        return _conversion(b, name, dtype, operands[0])
    if dtype == "bool":
        return _logic(b, name, operands)
    rules = _FLOAT if dtype in FLOATS else RULES
    rule = rules.get(name)
    return rule(b, dtype, *operands) if rule else None


def _is(b: ProgramWriter, i: int, value: float) -> bool:
    """Whether an operation is this constant, its sign of zero included."""
    constant = b.constants.get(i)
    return (
        constant is not None
        and constant == value
        and bool(np.signbit(constant)) == (math.copysign(1.0, value) < 0)
    )


# --- floats ---------------------------------------------------------------------------------------
# --------------------


def _add(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    for p, q in ((x, y), (y, x)):
        if _is(b, p, -0.0):
            return q
        if negated := operands_of(b, p, "neg"):
            return b.emit("sub", dtype, q, negated[0])
    return None


def _sub(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    if _is(b, y, 0.0):
        return x
    if _is(b, x, -0.0):
        return b.emit("neg", dtype, y)
    if negated := operands_of(b, y, "neg"):
        return b.emit("add", dtype, x, negated[0])
    return None


def _mul(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    for p, q in ((x, y), (y, x)):
        if _is(b, p, 1.0):
            return q
        if _is(b, p, -1.0):
            return b.emit("neg", dtype, q)
    for p, q in ((x, y), (y, x)):
        if negated := operands_of(b, p, "neg"):
            return b.emit("neg", dtype, b.emit("mul", dtype, negated[0], q))
    return None


def _div(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
    divisor = b.constants.get(y)
    if (
        divisor is not None
        and divisor != 0
        and np.isfinite(divisor)
        and abs(math.frexp(float(divisor))[0]) == 0.5
    ):
        inverse = 1.0 / float(divisor)
        if np.finfo(dtype).tiny <= abs(inverse) <= np.finfo(dtype).max:
            return b.emit("mul", dtype, x, b.constant(dtype, inverse))
    for p, q in ((x, y), (y, x)):
        if negated := operands_of(b, p, "neg"):
            quotient = (negated[0], q) if p == x else (q, negated[0])
            return b.emit("neg", dtype, b.emit("div", dtype, *quotient))
    return None


def _abs(b: ProgramWriter, dtype: str, x: int) -> int | None:
    if operands_of(b, x, "abs") or operands_of(b, x, "sqrt"):
        return x if operands_of(b, x, "abs") else None
    negated = operands_of(b, x, "neg")
    return b.emit("abs", dtype, negated[0]) if negated else None


def _whole(b: ProgramWriter, dtype: str, x: int) -> int | None:
    """floor, ceil and round of a whole number."""
    operation = b.operations[x]
    if operation.name in ("floor", "ceil", "round"):
        return x
    source = operation.operands[0] if operation.name == "convert" else None
    return x if source is not None and b.operations[source].dtype in ("int32", "uint32") else None


def _extreme(name: str):
    def rule(b: ProgramWriter, dtype: str, x: int, y: int) -> int | None:
        if x == y:
            return x
        if y in b.constants and not np.isnan(
            b.constants[y]
        ):  # a constant first: no NaN can come from there
            return b.emit(name, dtype, y, x)
        return None

    return rule


_FLOAT = {
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "neg": neg,
    "abs": _abs,
    "floor": _whole,
    "ceil": _whole,
    "round": _whole,
    "max": _extreme("max"),
    "min": _extreme("min"),
}


# --- truth values ---------------------------------------------------------------------------------
# --------------------


def _logic(b: ProgramWriter, name: str, operands: tuple[int, ...]) -> int | None:
    if name == "not":
        inner = operands_of(b, operands[0], "not")
        if inner:
            return inner[0]
        equal = b.operations[operands[0]]
        if equal.name in ("eq", "ne"):
            return b.emit("ne" if equal.name == "eq" else "eq", "bool", *equal.operands)
        return None
    if name not in ("and", "or", "xor"):
        return None
    x, y = operands
    if x == y:
        return x if name != "xor" else b.constant("bool", False)
    for p, q in ((x, y), (y, x)):
        if p in b.constants:
            if name == "xor":
                return b.emit("not", "bool", q) if b.constants[p] else q
            return q if bool(b.constants[p]) == (name == "and") else p
        if operands_of(b, p, "not") == (q,):
            return b.constant("bool", name != "and")
        inner = operands_of(b, p, name)
        if name != "xor" and inner and q in inner:
            return p
    return None


def _comparison(b: ProgramWriter, name: str, operands: tuple[int, ...]) -> int | None:
    x, y = operands
    dtype = b.operations[x].dtype
    if dtype == "bool":
        different = b.emit("xor", "bool", x, y)
        return (
            b.emit("not", "bool", different)
            if name == "eq"
            else different
            if name == "ne"
            else None
        )
    if x == y and dtype not in FLOATS:
        return b.constant("bool", name in ("eq", "le"))
    for p, q in ((x, y), (y, x)):
        choice = operands_of(b, p, "select")
        if choice and q in b.constants and choice[1] in b.constants and choice[2] in b.constants:
            sides = (choice[1:], (q, q)) if p == x else ((q, q), choice[1:])
            yes, no = (
                b.emit(name, "bool", left, right) for left, right in zip(*sides, strict=True)
            )
            return b.emit("select", "bool", choice[0], yes, no)
    if (
        dtype in FLOATS
        and (left := operands_of(b, x, "neg"))
        and ((right := operands_of(b, y, "neg")) or y in b.constants)
    ):
        other = right[0] if right else b.emit("neg", dtype, y)
        pair = (left[0], other) if name in ("eq", "ne") else (other, left[0])
        return b.emit(name, "bool", *pair)
    return None


def _choice(b: ProgramWriter, dtype: str, condition: int, yes: int, no: int) -> int | None:
    if yes == no:
        return yes
    if condition in b.constants:
        return yes if b.constants[condition] else no
    if inverted := operands_of(b, condition, "not"):
        return b.emit("select", dtype, inverted[0], no, yes)
    if (inner := operands_of(b, yes, "select")) and inner[0] == condition:
        return b.emit("select", dtype, condition, inner[1], no)
    if (inner := operands_of(b, no, "select")) and inner[0] == condition:
        return b.emit("select", dtype, condition, yes, inner[2])
    if dtype == "bool":
        return _chosen_truth(b, condition, yes, no)
    return _as_c_truncates(b, dtype, condition, yes, no)


def _rare_choice(b: ProgramWriter, condition: int, yes: int, no: int) -> int | None:
    if yes == no:
        return yes
    return (yes if b.constants[condition] else no) if condition in b.constants else None


def _chosen_truth(b: ProgramWriter, condition: int, yes: int, no: int) -> int | None:
    if yes in b.constants:
        if b.constants[yes]:
            return b.emit("or", "bool", condition, no)
        return b.emit("and", "bool", b.emit("not", "bool", condition), no)
    if no in b.constants:
        if b.constants[no]:
            return b.emit("or", "bool", b.emit("not", "bool", condition), yes)
        return b.emit("and", "bool", condition, yes)
    return None


def _as_c_truncates(b: ProgramWriter, dtype: str, condition: int, yes: int, no: int) -> int | None:
    """`types.to_int32` spelt out becomes one operation."""
    if dtype != "int32" or no not in b.constants or b.constants[no] != -2147483648:
        return None
    converted = operands_of(b, yes, "convert")
    choice = converted and operands_of(b, converted[0], "select")
    if not choice or choice[0] != condition or choice[2] not in b.constants:
        return None
    x = choice[1]
    real = b.operations[x].dtype
    low, high = b.constant(real, -2147483648.0), b.constant(real, 2147483648.0)
    fits = b.emit("and", "bool", b.emit("le", "bool", low, x), b.emit("lt", "bool", x, high))
    return b.emit("truncate", "int32", x) if fits == condition else None


def _conversion(b: ProgramWriter, name: str, dtype: str, x: int) -> int | None:
    source = b.operations[x].dtype
    if source == dtype:
        return x
    if name == "bitcast":
        inner = operands_of(b, x, "bitcast")
        return b.emit("bitcast", dtype, inner[0]) if inner else None
    if source == "bool":
        return b.emit("select", dtype, x, b.constant(dtype, 1), b.constant(dtype, 0))
    if dtype == "bool":
        return b.emit("ne", "bool", x, b.constant(source, 0))
    if source in ("int32", "uint32") and dtype in ("int32", "uint32"):
        return b.emit("bitcast", dtype, x)
    choice = operands_of(b, x, "select")
    if choice and choice[1] in b.constants and choice[2] in b.constants:
        return b.emit(
            "select", dtype, choice[0], *(b.emit("convert", dtype, side) for side in choice[1:])
        )
    return None
