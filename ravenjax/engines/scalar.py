"""A traced function of single numbers as straight-line Python: every operation one IEEE operation, nothing fused.

XLA may contract a product and a sum into one rounding, and evaluates sines by its own polynomials; code that has to
meet another program bit by bit must do neither. `compile` prints a closed jaxpr as one Python function without loops or
branches and runs that. Numbers are Python `float` (float64), `numpy.float32`, Python `int` (integers, wrapped to their
width) and `bool`; float64 functions are those of the C library.

Known primitives are those of scalar code; jit-like calls are inlined, equal expressions are computed once, dead ones
dropped, constants folded. Anything else is refused by name. Tables are 1-D arrays that are read at one index.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

from ravenjax.engines import scalar_math

Number = Any

_RUNTIME = {
    name: getattr(scalar_math, name) for name in vars(scalar_math) if name.startswith("_") and not name.startswith("__")
} | {"_f32": np.float32}

_INFIX = {"add": "+", "sub": "-", "mul": "*"}
_COMPARE = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_BITWISE = {"and": "&", "or": "|", "xor": "^"}
_UNARY = ("sin", "cos", "tan", "asin", "acos", "atan", "sqrt", "exp", "log", "log1p", "expm1", "tanh", "floor", "ceil")
_ALIASES = ("copy", "copy_p", "squeeze", "reshape", "broadcast_in_dim", "stop_gradient")
_OVERFLOWING = (*_INFIX, "neg", "abs", "not", "square", "integer_pow", "shift_left", "shift_right_logical")
_CALLS = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "core_call": "call_jaxpr"} | {
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
}


class UnknownPrimitive(NotImplementedError):
    """The jaxpr holds something that is not an operation on single numbers."""


def primitives(jaxpr: core.ClosedJaxpr) -> dict[str, int]:
    """How often each primitive occurs once calls are inlined."""
    count: dict[str, int] = {}

    def walk(body: core.Jaxpr) -> None:
        for eqn in body.eqns:
            name = eqn.primitive.name
            if name in _CALLS:
                walk(_body(eqn)[0])
            else:
                count[name] = count.get(name, 0) + 1

    walk(jaxpr.jaxpr)
    return count


def _body(eqn: core.JaxprEqn) -> tuple[core.Jaxpr, Sequence[Any]]:
    inner = eqn.params[_CALLS[eqn.primitive.name]]
    return (inner.jaxpr, inner.consts) if hasattr(inner, "jaxpr") else (inner, ())


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
        return scalar_math._wrap(int(value), dtype.itemsize * 8, dtype.kind == "i")
    return np.float32(value) if dtype == np.float32 else float(value)


def compile(jaxpr: core.ClosedJaxpr) -> ScalarFunction:
    """Print a closed jaxpr of single numbers (`jax.make_jaxpr(f)(...)`) and make a function of it."""
    printer = _Printer()
    inputs = [printer.input(var.aval) for var in jaxpr.jaxpr.invars]
    outputs = printer.body(jaxpr.jaxpr, [printer.constant(c) for c in jaxpr.consts], inputs)
    source, constants, operations = printer.source(inputs, outputs)
    scope: dict[str, Any] = dict(_RUNTIME)
    scope.update(constants)
    exec(source, scope)
    evaluate = scope["evaluate"]

    def run(numbers: Sequence[Number]) -> list[Number]:
        with np.errstate(all="ignore"):
            return evaluate(numbers)

    return ScalarFunction(
        source,
        operations,
        tuple(map(_dtype, jaxpr.jaxpr.invars)),
        tuple(map(_dtype, jaxpr.jaxpr.outvars)),
        run,
    )


@dataclasses.dataclass(frozen=True)
class _Value:
    """An operand: its text, its type, and what it is if it is a constant."""

    text: str
    dtype: np.dtype
    constant: Any = None


def _dtype(atom: Any) -> np.dtype:
    return np.dtype(atom.aval.dtype)


class _Printer:
    def __init__(self) -> None:
        self.lines: dict[str, tuple[str, tuple[str, ...]]] = {}  # name -> (expression, names it needs)
        self.constants: dict[str, Any] = {}
        self._known: dict[Any, _Value] = {}

    # --- values ---

    def input(self, aval: Any) -> _Value:
        if len(aval.shape) > 1:
            raise UnknownPrimitive(f"an input has shape {aval.shape}; give single numbers or 1-D tables")
        value = _Value(f"i{len(self._known)}", np.dtype(aval.dtype))
        self._known[value.text] = value
        return value

    def constant(self, value: Any) -> _Value:
        dtype = np.dtype(getattr(value, "dtype", np.asarray(value).dtype))
        if np.size(value) > 1:
            return self._bind(np.asarray(value), dtype, ("table", id(value)))
        return self.number(represent(dtype, np.asarray(value).reshape(()).item()), dtype)

    def number(self, value: Number, dtype: np.dtype) -> _Value:
        plain = dtype.kind in "biu" or (dtype == np.float64 and math.isfinite(value) and math.copysign(1.0, value) > 0)
        if plain:
            return _Value(repr(value), dtype, value)
        return self._bind(value, dtype, (dtype.str, float(value).hex()))

    def _bind(self, value: Any, dtype: np.dtype, key: Any) -> _Value:
        if key not in self._known:
            name = f"c{len(self.constants)}"
            self.constants[name] = value
            self._known[key] = _Value(name, dtype, value)
        return self._known[key]

    def emit(self, expression: str, operands: Sequence[_Value], dtype: np.dtype) -> _Value:
        """The value of an expression, in which {0}, {1}.. stand for the operands."""
        text = expression.format(*(operand.text for operand in operands))
        key = (text, dtype.str)
        if key not in self._known:
            if all(operand.constant is not None for operand in operands) and not any(map(_is_table, operands)):
                with np.errstate(all="ignore"):
                    folded = eval(text, {**_RUNTIME, **self.constants})
                self._known[key] = self.number(represent(dtype, folded), dtype)
            else:
                name = f"v{len(self.lines)}"
                self.lines[name] = (text, tuple(operand.text for operand in operands))
                self._known[key] = _Value(name, dtype)
        return self._known[key]

    # --- the walk ---

    def body(self, jaxpr: core.Jaxpr, consts: Sequence[_Value], inputs: Sequence[_Value]) -> list[_Value]:
        values: dict[Any, _Value] = dict(zip(jaxpr.constvars, consts, strict=True))
        values.update(zip(jaxpr.invars, inputs, strict=True))

        def read(atom: Any) -> _Value:
            if isinstance(atom, core.Literal):
                return self.constant(np.asarray(atom.val, _dtype(atom)))
            return values[atom]

        for eqn in jaxpr.eqns:
            operands = [read(atom) for atom in eqn.invars]
            name = eqn.primitive.name
            if name in _CALLS:
                inner, inner_consts = _body(eqn)
                results = self.body(inner, [self.constant(c) for c in inner_consts], operands)
            elif name == "cond":
                results = self._branches(eqn, operands)
            elif name == "optimization_barrier":
                results = operands
            else:
                results = [self.equation(eqn, operands)]
            values.update(zip(eqn.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def _branches(self, eqn: core.JaxprEqn, operands: list[_Value]) -> list[_Value]:
        """Both branches of two, and a choice between each pair of results."""
        usual, rare = (
            self.body(branch.jaxpr, [self.constant(c) for c in branch.consts], operands[1:])
            for branch in eqn.params["branches"]
        )
        return [
            self.emit("({1} if {0} else {2})", [operands[0], x, y], x.dtype) for x, y in zip(rare, usual, strict=True)
        ]

    def equation(self, eqn: core.JaxprEqn, operands: list[_Value]) -> _Value:
        aval: Any = eqn.outvars[0].aval
        dtype = np.dtype(aval.dtype)
        if dtype.kind not in "biu" and dtype not in (np.float32, np.float64):
            raise UnknownPrimitive(f"{eqn.primitive.name} gives {dtype}; known are bool, integers, float32 and float64")
        if math.prod(aval.shape) != 1:
            raise UnknownPrimitive(f"{eqn.primitive.name} gives shape {aval.shape}; only single numbers are known")
        expression = _expression(eqn, operands, dtype)
        if isinstance(expression, _Value):
            return expression
        return self.emit(_stored(expression, eqn.primitive.name, dtype), operands, dtype)

    # --- the text ---

    def source(self, inputs: Sequence[_Value], outputs: Sequence[_Value]) -> tuple[str, dict[str, Any], int]:
        needed: set[str] = set()
        pending = [output.text for output in outputs]
        while pending:
            name = pending.pop()
            if name not in needed:
                needed.add(name)
                pending.extend(self.lines.get(name, ("", ()))[1])
        body = [f"    {name} = {text}" for name, (text, _) in self.lines.items() if name in needed]
        constants = {name: value for name, value in self.constants.items() if name in needed}
        lines = ["def evaluate(numbers):"]
        if inputs:
            lines.append(f"    {', '.join(value.text for value in inputs)}, = numbers")
        lines += [*body, f"    return [{', '.join(output.text for output in outputs)}]"]
        return "\n".join(lines), constants, len(body)


def _is_table(value: _Value) -> bool:
    return isinstance(value.constant, np.ndarray)


def _stored(expression: str, name: str, dtype: np.dtype) -> str:
    """What an operation's raw result needs to become a number of its type."""
    if dtype.kind in "iu" and name in _OVERFLOWING:
        if dtype == np.int32:
            return f"(({expression}) + 2147483648 & 4294967295) - 2147483648"
        return f"_wrap({expression}, {dtype.itemsize * 8}, {dtype.kind == 'i'})"
    if dtype == np.float32 and name in (*_UNARY, "atan2", "pow", "rem", "round", "sign"):
        return f"_f32({expression})"
    return expression


def _expression(eqn: core.JaxprEqn, operands: list[_Value], dtype: np.dtype) -> str | _Value:
    """The operation on operands {0}, {1}..; an operand itself where there is nothing to do."""
    name, params = eqn.primitive.name, eqn.params
    real = dtype.kind == "f"
    if name in _ALIASES:
        return operands[0]
    if name in _INFIX:
        return f"{{0}} {_INFIX[name]} {{1}}"
    if name in _COMPARE:
        return f"{{0}} {_COMPARE[name]} {{1}}"
    if name in _BITWISE:
        return f"{{0}} {_BITWISE[name]} {{1}}"
    if name in _UNARY:
        return f"_{name}({{0}})"
    match name:
        case "neg":
            return "-{0}"
        case "not":
            return "not {0}" if dtype.kind == "b" else "~{0}"
        case "abs":
            return "abs({0})"
        case "div":
            return ("{0} / {1}" if dtype == np.float32 else "_div({0}, {1})") if real else "_quotient({0}, {1})"
        case "rem":
            return "_rem({0}, {1})" if real else "{0} - _quotient({0}, {1}) * {1}"
        case "square":
            return "{0} * {0}"
        case "integer_pow":
            return _power(params["y"], dtype)
        case "rsqrt":
            return "_f32(1.0) / _f32(_sqrt({0}))" if dtype == np.float32 else "_div(1.0, _sqrt({0}))"
        case "atan2" | "pow":
            return f"_{name}({{0}}, {{1}})"
        case "round":
            if int(params["rounding_method"]) != 1:
                raise UnknownPrimitive("round away from zero is not known; use round to nearest even (jnp.round)")
            return "_round({0})"
        case "sign":
            return "_sign({0})" if real else "({0} > 0) - ({0} < 0)"
        case "is_finite":
            return "_isfinite({0})"
        case "max" | "min":
            order = ">" if name == "max" else "<"
            return f"({{0}} if {{0}} {order} {{1}} or {{0}} != {{0}} else {{1}})"
        case "clamp":
            return "({0} if {1} < {0} else {2} if {1} > {2} else {1})"
        case "select_n":
            if operands[1].text == operands[-1].text and len(operands) == 3:
                return operands[1]
            if len(operands) != 3 or operands[0].dtype.kind != "b":
                raise UnknownPrimitive("select_n by an integer is not known; use nested two-way choices (jnp.where)")
            return "({2} if {0} else {1})"
        case "shift_left":
            return "{0} << {1}"
        case "shift_right_arithmetic":
            return "{0} >> {1}"
        case "shift_right_logical":
            return f"({{0}} & {2 ** (8 * dtype.itemsize) - 1}) >> {{1}}"
        case "convert_element_type":
            return _converted(operands[0], dtype)
        case "dynamic_slice" | "gather":
            return _looked_up(eqn, dtype)
    raise UnknownPrimitive(f"primitive {name!r} is not an operation on single numbers that this printer knows")


def _power(exponent: int, dtype: np.dtype) -> str:
    """Repeated products, as XLA expands an integer power."""
    text = " * ".join(["{0}"] * abs(exponent)) if exponent else "1.0"
    if exponent >= 0:
        return text if exponent else ("_f32(1.0)" if dtype == np.float32 else "1.0")
    return f"_f32(1.0) / ({text})" if dtype == np.float32 else f"_div(1.0, {text})"


def _converted(operand: _Value, dtype: np.dtype) -> str | _Value:
    if operand.dtype == dtype:
        return operand
    if dtype.kind == "b":
        return "{0} != 0"
    if dtype == np.float32:
        return "_f32({0})"
    if dtype == np.float64:
        return "float({0})"
    bits, signed = dtype.itemsize * 8, dtype.kind == "i"
    if operand.dtype.kind == "f":
        return f"_to_integer({{0}}, {bits}, {signed})"
    return "int({0})" if operand.dtype.kind == "b" else f"_wrap({{0}}, {bits}, {signed})"


def _looked_up(eqn: core.JaxprEqn, dtype: np.dtype) -> str:
    """One number of a 1-D table; an index outside reads the nearest end (or, of a gather that fills, NaN)."""
    table: Any = eqn.invars[0].aval
    if len(table.shape) != 1 or len(eqn.invars) != 2 or tuple(eqn.params["slice_sizes"]) != (1,):
        raise UnknownPrimitive(f"{eqn.primitive.name} of shape {table.shape}; only one number of a 1-D table is known")
    read = {"f": "float", "b": "bool"}.get(dtype.kind, "int") if dtype != np.float32 else ""
    inside = f"{read}({{0}}[min(max({{1}}, 0), {table.shape[0] - 1})])"
    mode = eqn.params.get("mode")
    if mode is not None and mode == jax.lax.GatherScatterMode.FILL_OR_DROP and dtype.kind == "f":
        nan = "_f32('nan')" if dtype == np.float32 else "float('nan')"
        return f"({inside} if 0 <= {{1}} < {table.shape[0]} else {nan})"
    return inside
