"""Builds straight-line programs: programs of operations on single numbers, without loops.

The builder shares common subexpressions, folds constants and simplifies operations. A simplified
operation gives the same bits for all operands, except for the payload of a NaN. Each rule of
simplification shortens the robot's tick, or moves a minus sign out of a product so that
`contract_to_fma` can fuse the product with a sum.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.ir import semantics
from ravenjax.ir.program import Operation, Program, to_bits

COMMUTATIVE = frozenset(("add", "mul", "and", "or", "xor", "eq", "ne"))


class Builder:
    """Writes a program, operation by operation."""

    def __init__(self):
        self.operations: list[Operation] = []
        self.constants: dict[int, Any] = {}  # operation -> NumPy number
        self.inputs: list[str] = []
        self.tables: list[tuple[str, int]] = []
        self._numbers: dict[Operation, int] = {}

    def input(self, dtype: str) -> int:
        """Add an input; return its number."""
        self.inputs.append(dtype)
        return self._write(Operation("input", dtype, (), len(self.inputs) - 1))

    def table(self, dtype: str, length: int) -> int:
        """Add a table; return its number."""
        self.tables.append((dtype, length))
        return len(self.tables) - 1

    def constant(self, dtype: str, value: Any) -> int:
        """Return the number of an operation that gives this constant; it is added only once."""
        i = self._write(Operation("constant", dtype, (), to_bits(dtype, value)))
        if i not in self.constants:
            self.constants[i] = self.operations[i].value
        return i

    def emit(self, name: str, dtype: str, *operands: int) -> int:
        """Return the number of an operation with this result, equal or simpler if there is one."""
        if all(o in self.constants for o in operands):
            constants = tuple(self.constants[o] for o in operands)
            return self.constant(dtype, semantics.evaluate_operation(name, dtype, constants))
        if name in COMMUTATIVE and operands[0] > operands[1]:
            operands = (operands[1], operands[0])
        simpler = _simplify(self, name, dtype, operands)
        return self._write(Operation(name, dtype, operands)) if simpler is None else simpler

    def lookup(self, table: int, index: int) -> int:
        """Return the number of `table` at `index`, which must be inside."""
        return self._write(Operation("lookup", self.tables[table][0], (index,), table))

    def program(self, outputs: Sequence[int]) -> Program:
        """Return the program written so far."""
        operations, inputs = tuple(self.operations), tuple(self.inputs)
        return Program(operations, inputs, tuple(outputs), tuple(self.tables))

    def _write(self, operation: Operation) -> int:
        # Returns the number of an operation. An equal operation is added only once.
        number = self._numbers.get(operation)
        if number is None:
            number = self._numbers[operation] = len(self.operations)
            self.operations.append(operation)
        return number


FLOATS = ("float32", "float64")


def _simplify(b: Builder, name: str, dtype: str, operands: tuple[int, ...]) -> int | None:
    # Returns the number of a simpler operation with the same result, to the bit. Returns None if no
    # rule applies. `operands` are numbers of earlier operations.
    if name in ("convert", "bitcast"):
        return _simplify_conversion(b, name, dtype, operands[0])
    if name == "select":
        return _simplify_select(b, dtype, *operands)
    if name in ("shl", "shr"):
        amount = b.constants.get(operands[1])
        shifts_all_out = amount is not None and not 0 <= int(amount) < np.dtype(dtype).itemsize * 8
        return b.constant(dtype, 0) if shifts_all_out else None
    if dtype == "bool" and name in ("and", "or", "xor"):
        return _simplify_logic(b, name, *operands)
    if name == "neg":
        return _negation_operand(b, operands[0])
    if dtype in FLOATS and name in ("max", "min"):
        return _simplify_max_or_min(b, name, dtype, *operands)
    rule = {
        "add": _simplify_sum,
        "sub": _simplify_difference,
        "mul": _simplify_product,
        "div": _simplify_quotient,
    }.get(name)
    return rule(b, dtype, *operands) if rule and dtype in FLOATS else None


def _operands_if_named(b: Builder, i: int, name: str) -> tuple[int, ...]:
    # Returns the operands of operation `i` if its name is `name`, else ().
    operation = b.operations[i]
    return operation.operands if operation.name == name else ()


def _negation_operand(b: Builder, i: int) -> int | None:
    # Returns x if operation `i` is -x, else None.
    return next(iter(_operands_if_named(b, i, "neg")), None)


def _is_constant(b: Builder, i: int, value: float) -> bool:
    """Return whether operation `i` is the constant `value`, with the same sign of zero."""
    constant = b.constants.get(i)
    if constant is None:
        return False
    return constant == value and np.signbit(constant) == np.signbit(value)


def _simplify_sum(b: Builder, dtype: str, x: int, y: int) -> int | None:
    # Simplifies x + y: x + -0 is x, and x + (-y) is x - y. But x + 0 is not x if x is -0.
    for p, q in ((x, y), (y, x)):
        if _is_constant(b, p, -0.0):
            return q
        if (inner := _negation_operand(b, p)) is not None:
            return b.emit("sub", dtype, q, inner)
    return None


def _simplify_difference(b: Builder, dtype: str, x: int, y: int) -> int | None:
    # Simplifies x - y: x - 0 is x. But 0 - x is not -x if x is 0.
    if _is_constant(b, y, 0.0):
        return x
    if _is_constant(b, x, -0.0):
        return b.emit("neg", dtype, y)
    inner = _negation_operand(b, y)
    return None if inner is None else b.emit("add", dtype, x, inner)


def _simplify_product(b: Builder, dtype: str, x: int, y: int) -> int | None:
    # Simplifies x y where a factor is 1, -1 or negated.
    pairs = (x, y), (y, x)
    for p, q in pairs:
        if _is_constant(b, p, 1.0):
            return q
        if _is_constant(b, p, -1.0):
            return b.emit("neg", dtype, q)
    for p, q in pairs:
        if (inner := _negation_operand(b, p)) is not None:
            return b.emit("neg", dtype, b.emit("mul", dtype, inner, q))
    return None


def _simplify_quotient(b: Builder, dtype: str, x: int, y: int) -> int | None:
    """Return a product for a division by a power of two: only products can be fused with sums. A
    minus sign of x or y is moved out of the division. Returns None if neither applies.
    """
    divisor = b.constants.get(y)
    # frexp gives the mantissa, which is 0.5 or -0.5 for a power of two, and the exponent.
    if divisor is not None and np.isfinite(divisor) and abs(math.frexp(divisor)[0]) == 0.5:
        inverse = 1.0 / float(divisor)
        if np.finfo(dtype).tiny <= abs(inverse) <= np.finfo(dtype).max:
            return b.emit("mul", dtype, x, b.constant(dtype, inverse))
    for p, q in ((x, y), (y, x)):
        if (inner := _negation_operand(b, p)) is not None:
            quotient = (inner, q) if p == x else (q, inner)
            return b.emit("neg", dtype, b.emit("div", dtype, *quotient))
    return None


def _simplify_max_or_min(b: Builder, name: str, dtype: str, x: int, y: int) -> int | None:
    # Simplifies max and min of floats: max(x, x) is x. A constant becomes the first operand.
    if x == y:
        return x
    # The operands of max and min may be exchanged only if the constant is not NaN.
    is_exchanged = y in b.constants and not np.isnan(b.constants[y])
    return b.emit(name, dtype, y, x) if is_exchanged else None


def _simplify_logic(b: Builder, name: str, x: int, y: int) -> int | None:
    # Simplifies and, or, xor of truth values where an operand is a constant.
    for p, q in ((x, y), (y, x)):
        if p in b.constants:
            if name == "xor":
                return b.emit("not", "bool", q) if b.constants[p] else q
            # `q and True` and `q or False` are q. `q and False` and `q or True` are the constant p.
            return q if bool(b.constants[p]) == (name == "and") else p
    return None


def _simplify_select(b: Builder, dtype: str, condition: int, yes: int, no: int) -> int | None:
    # Simplifies a `select` with equal results or a constant condition. Also recognizes what
    # `vec.to_int32` writes, which becomes the operation `truncate` of x:
    # select(fits, convert(select(fits, x, 0)), -2147483648).
    if yes == no:
        return yes
    if condition in b.constants:
        return yes if b.constants[condition] else no
    if dtype != "int32" or no not in b.constants or b.constants[no] != -2147483648:
        return None
    converted = _operands_if_named(b, yes, "convert")
    choice = converted and _operands_if_named(b, converted[0], "select")
    if not choice or choice[0] != condition or choice[2] not in b.constants:
        return None
    x = choice[1]
    real = b.operations[x].dtype
    low, high = b.constant(real, -2147483648.0), b.constant(real, 2147483648.0)
    fits = b.emit("and", "bool", b.emit("le", "bool", low, x), b.emit("lt", "bool", x, high))
    return b.emit("truncate", "int32", x) if fits == condition else None


def _simplify_conversion(b: Builder, name: str, dtype: str, x: int) -> int | None:
    # Simplifies conversions to the same type. Those from bool become selects, those to bool `ne 0`.
    source = b.operations[x].dtype
    if source == dtype:
        return x
    if source == "bool":
        return b.emit("select", dtype, x, b.constant(dtype, 1), b.constant(dtype, 0))
    return b.emit("ne", "bool", x, b.constant(source, 0)) if dtype == "bool" else None


def contract_to_fma(program: Program) -> Program:
    """Return the program with each sum of a product as one `fma`, without unneeded operations.
    Whether a sum is fused depends only on its operands, not on parts that are left out.
    """
    builder = Builder()
    builder.inputs, builder.tables = list(program.inputs), list(program.tables)
    # Number of an operation in `program` -> its number in the new program.
    new = {}
    for i in program.needed():
        name, dtype, old_operands, detail = program.operations[i]
        operands = tuple(new[o] for o in old_operands)
        if (fused := _fuse(builder, name, dtype, operands)) is not None:
            new[i] = fused
        elif name == "constant":
            new[i] = builder.constant(dtype, program.operations[i].value)
        elif name in ("input", "lookup"):
            new[i] = builder._write(Operation(name, dtype, operands, detail))
        else:
            new[i] = builder.emit(name, dtype, *operands)
    return builder.program([new[i] for i in program.outputs])


def _fuse(b: Builder, name: str, dtype: str, operands: tuple[int, ...]) -> int | None:
    """Return the `fma` of a sum or difference with a product; None for any other operation."""
    if name not in ("add", "sub") or dtype not in FLOATS:
        return None
    for k in (0, 1):
        product, c = b.operations[operands[k]], operands[1 - k]
        if product.name == "mul":
            x, y = product.operands
            # x y - c is fma(x, y, -c). If the product is the second operand (k = 1), c - x y is
            # fma(-x, y, c).
            if name == "sub":
                x, c = (b.emit("neg", dtype, x), c) if k else (x, b.emit("neg", dtype, c))
            return b.emit("fma", dtype, x, y, c)
    return None
