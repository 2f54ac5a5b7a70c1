"""A function of single numbers as straight-line Python: every operation one IEEE operation, nothing
fused.

XLA may contract a product and a sum into one rounding, and evaluates sines by its own polynomials;
code that has to meet another program bit by bit must do neither. `compile` prints a closed jaxpr as
one Python function without loops or branches and runs that. Numbers are Python `float` (float64),
`numpy.float32`, Python `int` (integers, wrapped to their width) and `bool`; functions are those of
the C library. Tables are 1-D arrays.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from jax.extend import core

from ravenjax.ir import elementary, semantics
from ravenjax.ir.lowering import lower
from ravenjax.ir.program import Operation, Program, number

Number = Any

_INFIX = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^"}
_COMPARISONS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<="}
_OVERFLOWING = ("add", "sub", "mul", "neg", "abs", "not", "div", "rem", "shl", "shr")
_SHIFTS = {
    "shl": "({{0}} << {{1}} if 0 <= {{1}} < {bits} else 0)",
    "shr": "(({{0}} & {mask}) >> {{1}} if 0 <= {{1}} < {bits} else 0)",
    "sar": "({{0}} >> ({{1}} if 0 <= {{1}} < {bits} else {bits} - 1))",
}
_ROUNDED = ("sqrt", "floor", "ceil", "round")


@dataclasses.dataclass(frozen=True)
class ScalarFunction:
    """A printed function; call it with a flat list of numbers in their representation."""

    source: str
    operations: int  # statements that are not input or output
    in_types: tuple[np.dtype, ...]
    out_types: tuple[np.dtype, ...]
    run: Callable[[Sequence[Number]], list[Number]]

    def __call__(self, numbers: Sequence[Number]) -> list[Number]:
        return self.run(numbers)

    def represent(self, numbers: Iterable[Any]) -> list[Number]:
        """Any numbers as the function takes them, rounded or wrapped to their types."""
        return [represent(dtype, x) for dtype, x in zip(self.in_types, numbers, strict=True)]


def represent(dtype: np.dtype, value: Any) -> Number:
    """`value` in the representation of `dtype`; a 1-D table stays an array."""
    if np.ndim(value):
        return np.asarray(value, dtype)
    if dtype.kind == "b":
        return bool(value)
    if dtype.kind in "iu":
        return _wrap(int(value), 8 * dtype.itemsize, dtype.kind == "i")
    return np.float32(value) if dtype == np.float32 else float(value)


def compile(jaxpr: core.ClosedJaxpr) -> ScalarFunction:
    """Print a closed jaxpr of single numbers (`jax.make_jaxpr(f)(...)`) and make a function of
    it.
    """
    program = lower(jaxpr, functions="library")
    arguments, body, scope = _printed(program, [bool(var.aval.shape) for var in jaxpr.jaxpr.invars])
    unpacked = [f"    {', '.join(arguments)}, = numbers"] if arguments else []
    source = "\n".join(["def evaluate(numbers):", *unpacked, *body])
    exec(source, scope)
    evaluate = scope["evaluate"]

    def run(numbers: Sequence[Number]) -> list[Number]:
        with np.errstate(all="ignore"):
            return evaluate(numbers)

    return ScalarFunction(
        source,
        len(body) - 1,
        tuple(np.dtype(var.aval.dtype) for var in jaxpr.jaxpr.invars),
        tuple(np.dtype(program.operations[i].dtype) for i in program.outputs),
        run,
    )


def _printed(
    program: Program, tables: Sequence[bool]
) -> tuple[list[str], list[str], dict[str, Any]]:
    """Names of the arguments (`tables`: which of them are tables), statements, and the scope
    that they run in.
    """
    scope: dict[str, Any] = dict(_RUNTIME)
    text: dict[int, str] = {}
    body: list[str] = []
    for i in program.needed():
        operation = program.operations[i]
        if operation.name == "input":
            text[i] = f"i{operation.detail}"
        elif operation.name == "constant":
            text[i] = _constant(operation, scope)
        else:
            operands = [program.operations[o] for o in operation.operands]
            template = _statement(operation, [operand.dtype for operand in operands], scope)
            body.append(f"    v{i} = {template.format(*(text[o] for o in operation.operands))}")
            text[i] = f"v{i}"
    numbers, arrays = iter(range(len(program.inputs))), iter(range(len(program.tables)))
    arguments = [f"t{next(arrays)}" if table else f"i{next(numbers)}" for table in tables]
    return arguments, [*body, f"    return [{', '.join(text[i] for i in program.outputs)}]"], scope


def _constant(operation: Operation, scope: dict[str, Any]) -> str:
    """Text of a constant; a name of the scope for what Python's literals cannot say."""
    dtype = np.dtype(operation.dtype)
    value = represent(dtype, number(operation.dtype, operation.detail))
    if dtype.kind in "biu" or (
        dtype == np.float64 and math.isfinite(value) and math.copysign(1.0, value) > 0
    ):
        return repr(value)
    name = f"c{operation.detail}_{operation.dtype}"
    scope[name] = value
    return name


def _statement(operation: Operation, sources: list[str], scope: dict[str, Any]) -> str:
    """The operation on operands {0}, {1}.. of types `sources`; what has no short form is left to
    `semantics`.
    """
    name, dtype = operation.name, np.dtype(operation.dtype)
    if name == "lookup":
        return f"{_READ.get(operation.dtype, 'int')}(t{operation.detail}[{{0}}])"
    form = _form(name, dtype, np.dtype(sources[0]))
    if form is None:
        key = f"_{name}_{'_'.join(sources)}_{operation.dtype}"
        scope[key] = _meant(operation, sources)
        return f"{key}({', '.join(f'{{{k}}}' for k in range(len(sources)))})"
    if dtype.kind in "iu" and name in _OVERFLOWING:
        if dtype == np.int32:
            return f"(({form}) + 2147483648 & 4294967295) - 2147483648"
        return f"_wrap({form}, {_width(dtype)})"
    if dtype == np.float32 and (name in elementary.FUNCTIONS or name in _ROUNDED):
        return f"_float32({form})"
    return form


def _form(name: str, dtype: np.dtype, source: np.dtype) -> str | None:
    real = dtype.kind == "f"
    if name in _INFIX:
        return f"{{0}} {_INFIX[name]} {{1}}"
    if name in _COMPARISONS:
        return f"{{0}} {_COMPARISONS[name]} {{1}}"
    if name in _SHIFTS:
        bits = 8 * dtype.itemsize
        return _SHIFTS[name].format(bits=bits, mask=2**bits - 1)
    if name in elementary.FUNCTIONS:
        return f"_{name}({{0}}, {{1}})" if name in ("atan2", "pow", "fmod") else f"_{name}({{0}})"
    if name in _ROUNDED:
        return f"_{name}({{0}})"
    match name:
        case "neg":
            return "-{0}"
        case "not":
            return "not {0}" if dtype.kind == "b" else "~{0}"
        case "abs":
            return "abs({0})"
        case "div":
            return (
                ("{0} / {1}" if dtype == np.float32 else "_div({0}, {1})")
                if real
                else "_quotient({0}, {1})"
            )
        case "rem":
            return "{0} - _quotient({0}, {1}) * {1} if {1} else {0}"
        case "max" | "min":
            return (
                f"({{0}} if {{0}} {'>' if name == 'max' else '<'} {{1}} or {{0}} != {{0}} else"
                " {1})"
            )
        case "select" | "rarely":
            return "({1} if {0} else {2})"
        case "convert" if dtype.kind == "b":
            return "{0} != 0"
        case "convert" if real:
            return "_float32({0})" if dtype == np.float32 else "float({0})"
        case "convert" if source.kind == "f":
            return f"_to_integer({{0}}, {_width(dtype)})"
        case "convert" | "bitcast" if dtype.kind in "iu" and source.kind in "iu":
            return f"_wrap({{0}}, {_width(dtype)})"
        case "truncate":
            return "(int({0}) if -2147483648.0 <= {0} < 2147483648.0 else -2147483648)"
    return None


def _width(dtype: np.dtype) -> str:
    return f"{8 * dtype.itemsize}, {dtype.kind == 'i'}"


def _meant(operation: Operation, sources: list[str]) -> Callable[..., Number]:
    def evaluate(*operands: Number) -> Number:
        typed = tuple(
            np.asarray(x, source)[()] for x, source in zip(operands, sources, strict=True)
        )
        return represent(
            np.dtype(operation.dtype), semantics.evaluate(operation.name, operation.dtype, typed)
        )

    return evaluate


# --- what the statements call
# -----------------------------------------------------------------------------------------


def _div(a: float, b: float) -> float:
    try:
        return a / b
    except ZeroDivisionError:
        if a == 0 or a != a:
            return math.nan
        return math.copysign(math.inf, a) * math.copysign(1.0, b)


def _quotient(a: int, b: int) -> int:
    """Integer division toward zero; -1 where b is 0, as XLA has it."""
    if b == 0:
        return -1
    quotient = abs(a) // abs(b)
    return quotient if (a < 0) == (b < 0) else -quotient


def _wrap(x: int, bits: int, signed: bool) -> int:
    """An integer modulo 2^bits, as a number of that width."""
    x &= (1 << bits) - 1
    return x - (1 << bits) if signed and x >> (bits - 1) else x


def _to_integer(x: float, bits: int, signed: bool) -> int:
    """Truncation toward zero; 0 for NaN and the nearest end for what does not fit, as XLA has
    it.
    """
    if x != x:
        return 0
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    return int(min(max(x, low), high))


def _whole(function: Callable[[float], float]) -> Callable[..., float]:
    """Rounding to a whole number that keeps the sign of zero."""
    return elementary.guarded(lambda x: math.copysign(float(function(float(x))), x), float)


_READ = {"bool": "bool", "float32": "", "float64": "float"}
_RUNTIME: dict[str, Any] = {
    f"_{name}": function for name, function in elementary.FUNCTIONS.items()
} | {
    "_float32": np.float32,
    "_sqrt": elementary.guarded(math.sqrt, lambda x: math.nan),
    "_floor": _whole(math.floor),
    "_ceil": _whole(math.ceil),
    "_round": _whole(round),
    "_div": _div,
    "_quotient": _quotient,
    "_wrap": _wrap,
    "_to_integer": _to_integer,
}
