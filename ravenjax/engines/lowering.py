"""A closed jaxpr of single numbers becomes a straight-line program: JAX's scalar primitives, one case each.

jit-like calls are inlined, functions (sin, atan2..) written out by `polynomials`, look-ups clamped to their table. What
is not an operation on single numbers, or on 1-D tables read at one index, is refused by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

from ravenjax.engines import polynomials
from ravenjax.engines.straight import TYPES, Builder, Program

_ALIASES = ("copy", "copy_p", "squeeze", "reshape", "broadcast_in_dim", "stop_gradient", "reduce_precision")
_SAME = ("add", "sub", "mul", "div", "and", "or", "xor", "not", "neg", "abs", "sqrt", "floor", "ceil", "max", "min")
_COMPARISONS = {"eq": "eq", "ne": "ne", "lt": "lt", "le": "le", "gt": "lt", "ge": "le"}
_SHIFTS = {"shift_left": "shl", "shift_right_logical": "shr", "shift_right_arithmetic": "sar"}
_CALLS = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
}

Origin = Callable[[core.JaxprEqn], str]


class UnknownPrimitive(NotImplementedError):
    """The jaxpr holds something that is not an operation on single numbers."""


def lower(jaxpr: core.ClosedJaxpr, origin: Origin | None = None) -> Program:
    """The program of a closed jaxpr (`jax.make_jaxpr(f)(...)`).

    Its inputs are the jaxpr's single numbers in order, its tables the 1-D ones. origin: names where an equation comes
    from; costs time. Raises UnknownPrimitive.
    """
    builder = Builder()
    walk = _Walk(builder, origin)
    consts = [walk.constant(value) for value in jaxpr.consts]
    inputs = [walk.input(var.aval) for var in jaxpr.jaxpr.invars]
    outputs = walk.body(jaxpr.jaxpr, consts, inputs)
    return builder.program([_single(output) for output in outputs])


class _Table:
    """A 1-D array, and how many numbers it has."""

    def __init__(self, number: int, length: int) -> None:
        self.number, self.length = number, length


_Value = int | _Table


def _single(value: _Value) -> int:
    if isinstance(value, _Table):
        raise UnknownPrimitive("a whole table is used as if it were one number; look one number of it up")
    return value


def _dtype(aval: Any) -> str:
    name = str(np.dtype(aval.dtype))
    if name not in TYPES:
        raise UnknownPrimitive(f"numbers of type {name} are not known; known are {', '.join(TYPES)}")
    return name


class _Walk:
    def __init__(self, builder: Builder, origin: Origin | None) -> None:
        self.builder, self.origin = builder, origin

    def input(self, aval: Any) -> _Value:
        if len(aval.shape) > 1:
            raise UnknownPrimitive(f"an input has shape {aval.shape}; give single numbers or 1-D tables")
        if aval.shape:
            return _Table(self.builder.table(_dtype(aval), aval.shape[0]), aval.shape[0])
        return self.builder.input(_dtype(aval))

    def constant(self, value: Any) -> _Value:
        if np.size(value) != 1:
            raise UnknownPrimitive(f"a constant has shape {np.shape(value)}; give tables as inputs")
        return self.builder.constant(_dtype(np.asarray(value)), np.asarray(value).reshape(()))

    def body(self, jaxpr: core.Jaxpr, consts: Sequence[_Value], inputs: Sequence[_Value]) -> list[_Value]:
        values: dict[Any, _Value] = dict(zip(jaxpr.constvars, consts, strict=True))
        values.update(zip(jaxpr.invars, inputs, strict=True))

        def read(atom: Any) -> _Value:
            if isinstance(atom, core.Literal):
                aval: Any = atom.aval
                return self.constant(np.asarray(atom.val, np.dtype(aval.dtype)))
            return values[atom]

        for eqn in jaxpr.eqns:
            operands = [read(atom) for atom in eqn.invars]
            name = eqn.primitive.name
            if name in _CALLS:
                inner, inner_consts = _callee(eqn)
                results = self.body(inner, [self.constant(c) for c in inner_consts], operands)
            elif name == "cond":
                results = self._branches(eqn, operands)
            elif name == "optimization_barrier":
                results = operands
            else:
                results = [self._equation(eqn, operands)]
            values.update(zip(eqn.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def _branches(self, eqn: core.JaxprEqn, operands: list[_Value]) -> list[_Value]:
        """Both branches, and a choice between each pair of results; the first branch is the usual one."""
        if len(eqn.params["branches"]) != 2:
            raise UnknownPrimitive(
                f"a choice of {len(eqn.params['branches'])} branches is not known; nest two-way ones"
            )
        b, index = self.builder, _single(operands[0])
        condition = b.emit("ne", "bool", index, b.constant(b.operations[index].dtype, 0))
        usual, rare = (
            self.body(branch.jaxpr, [self.constant(c) for c in branch.consts], operands[1:])
            for branch in eqn.params["branches"]
        )
        return [
            b.emit("rarely", b.operations[_single(x)].dtype, condition, _single(x), _single(y))
            for x, y in zip(rare, usual, strict=True)
        ]

    def _equation(self, eqn: core.JaxprEqn, operands: list[_Value]) -> int:
        aval: Any = eqn.outvars[0].aval
        name = eqn.primitive.name
        if math.prod(aval.shape) != 1:
            raise UnknownPrimitive(f"{name} gives shape {aval.shape}; only single numbers are known")
        if self.origin is not None:
            self.builder.origin = self.origin(eqn)
        if name in ("dynamic_slice", "gather"):
            return self._looked_up(eqn, operands)
        return self._operation(eqn, _dtype(aval), [_single(operand) for operand in operands])

    def _operation(self, eqn: core.JaxprEqn, dtype: str, x: list[int]) -> int:
        name, params, b = eqn.primitive.name, eqn.params, self.builder
        if name in _ALIASES:
            if name == "reduce_precision":
                raise UnknownPrimitive("reduce_precision is not known; convert to a type")
            return x[0]
        if name in _SAME:
            return b.emit(name, dtype, *x)
        if name in _COMPARISONS:
            return b.emit(_COMPARISONS[name], "bool", *(reversed(x) if name in ("gt", "ge") else x))
        if name in _SHIFTS:
            return b.emit(_SHIFTS[name], dtype, *x)
        if name in polynomials.FUNCTIONS:
            if dtype not in polynomials.TYPES:
                raise UnknownPrimitive(f"{name} of {dtype} is not known; known are {', '.join(polynomials.TYPES)}")
            return polynomials.write(name, polynomials.Arithmetic(b.emit, b.constant, dtype), *x)
        match name:
            case "rem" if not dtype.startswith("float"):
                return b.emit("rem", dtype, *x)
            case "square":
                return b.emit("mul", dtype, x[0], x[0])
            case "integer_pow":
                return self._power(dtype, x[0], params["y"])
            case "rsqrt":
                return b.emit("div", dtype, b.constant(dtype, 1.0), b.emit("sqrt", dtype, x[0]))
            case "round" if int(params["rounding_method"]) == 1:
                return b.emit("round", dtype, x[0])
            case "sign":
                return self._sign(dtype, x[0])
            case "is_finite":
                source = b.operations[x[0]].dtype
                return b.emit("lt", "bool", b.emit("abs", source, x[0]), b.constant(source, np.inf))
            case "clamp":
                return b.emit("min", dtype, b.emit("max", dtype, x[0], x[1]), x[2])
            case "select_n" if len(x) == 3 and b.operations[x[0]].dtype == "bool":
                return b.emit("select", dtype, x[0], x[2], x[1])
            case "convert_element_type":
                return b.emit("convert", dtype, x[0])
            case "bitcast_convert_type":
                return b.emit("bitcast", dtype, x[0])
        details = {key: params[key] for key in ("rounding_method",) if key in params}
        raise UnknownPrimitive(
            f"primitive {name!r} of {dtype} {details or ''} is not an operation on single numbers that is known here"
        )

    def _power(self, dtype: str, x: int, exponent: int) -> int:
        """Repeated squaring, as JAX expands an integer power."""
        b, result, square = self.builder, None, x
        for k in range(abs(exponent).bit_length()):
            square = square if k == 0 else b.emit("mul", dtype, square, square)
            if abs(exponent) >> k & 1:
                result = square if result is None else b.emit("mul", dtype, result, square)
        one = b.constant(dtype, 1)
        if result is None:
            return one
        return result if exponent > 0 else b.emit("div", dtype, one, result)

    def _sign(self, dtype: str, x: int) -> int:
        """-1, 0 or 1; a zero keeps its sign, NaN stays."""
        b = self.builder
        zero, one = b.constant(dtype, 0), b.constant(dtype, 1)
        if dtype == "uint32":
            return b.emit("min", dtype, x, one)
        below = b.emit("select", dtype, b.emit("lt", "bool", x, zero), b.constant(dtype, -1), x)
        return b.emit("select", dtype, b.emit("lt", "bool", zero, x), one, below)

    def _looked_up(self, eqn: core.JaxprEqn, operands: list[_Value]) -> int:
        """One number of a 1-D table; an index outside reads the nearest end."""
        table = operands[0]
        if not isinstance(table, _Table) or len(operands) != 2 or tuple(eqn.params["slice_sizes"]) != (1,):
            aval: Any = eqn.invars[0].aval
            name = f"{eqn.primitive.name} of shape {aval.shape}"
            raise UnknownPrimitive(f"{name}; only one number of a 1-D table is known")
        mode = eqn.params.get("mode")
        if mode is not None and mode == jax.lax.GatherScatterMode.FILL_OR_DROP:
            raise UnknownPrimitive("a gather that fills is not known; use .at[k].get(mode='clip')")
        b = self.builder
        index = b.emit("convert", "int32", _single(operands[1]))
        inside = b.emit(
            "min", "int32", b.emit("max", "int32", index, b.constant("int32", 0)), b.constant("int32", table.length - 1)
        )
        return b.lookup(table.number, inside)


def _callee(eqn: core.JaxprEqn) -> tuple[core.Jaxpr, Sequence[Any]]:
    closed: Any = eqn.params[_CALLS[eqn.primitive.name]]
    return (closed.jaxpr, closed.consts) if hasattr(closed, "jaxpr") else (closed, ())
