"""Converts a function traced by JAX (a closed jaxpr) to a straight-line program on single numbers.

Functions within functions, such as those of `jit`, are inlined. The index of a table is clamped to
the table. Operations other than those on single numbers, or on 1-D tables at one index, are refused
with an error that names the operation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ravenjax.ir import polynomials, semantics
from ravenjax.ir.builder import Builder
from ravenjax.ir.program import TYPES, WIDE_INTEGERS, Program
from ravenjax.numbers import lax

if TYPE_CHECKING:
    from jax.extend import core


def _emit_sign(b: Builder, dtype: str, x: int) -> int:
    # Emits the sign of a number: -1, 0 or 1, and NaN for NaN.
    zero, one = b.constant(dtype, 0), b.constant(dtype, 1)
    if dtype == "uint32":
        return b.emit("min", dtype, x, one)
    below = b.emit("select", dtype, b.emit("lt", "bool", x, zero), b.constant(dtype, -1), x)
    return b.emit("select", dtype, b.emit("lt", "bool", zero, x), one, below)


def _emit_power(b: Builder, dtype: str, x: int, exponent: int) -> int:
    # Computes a power by repeated squaring. A negative exponent divides 1 by the result.
    result, square = None, x
    # In step k, `square` becomes x^(2^k).
    for k in range(abs(exponent).bit_length()):
        square = square if k == 0 else b.emit("mul", dtype, square, square)
        if abs(exponent) >> k & 1:
            result = square if result is None else b.emit("mul", dtype, result, square)
    one = b.constant(dtype, 1)
    if result is None:
        return one
    return result if exponent > 0 else b.emit("div", dtype, one, result)


_ALIASES = ("copy", "copy_p", "squeeze", "reshape", "broadcast_in_dim", "stop_gradient")
_RENAMED = {
    "shift_left": "shl",
    "shift_right_logical": "shr",
    "shift_right_arithmetic": "sar",
    "add_any": "add",  # arises from derivatives
    "convert_element_type": "convert",
    "bitcast_convert_type": "bitcast",
}
_CALLS = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call")
_REMATERIALISED = ("remat", "checkpoint")
_SMALL = "expected single numbers or 1-D arrays"

Functions = Literal["polynomials", "library"]


class UnknownPrimitive(NotImplementedError):
    """The jaxpr contains something that is not an operation on single numbers."""


def lower_jaxpr(jaxpr: core.ClosedJaxpr, functions: Functions = "polynomials") -> Program:
    """Return the program of a closed jaxpr (`jax.make_jaxpr(f)(...)`). Raises UnknownPrimitive.
    Inputs of the program are the jaxpr's single numbers in order, and tables are its 1-D inputs.
    functions: with `polynomials`, sin, atan2 and similar functions become sums and products. With
    `library`, they remain functions of the C library, and integers may have 64 bits.
    """
    builder = Builder()
    lowering = _Lowering(builder, functions)
    consts = [lowering.constant(value) for value in jaxpr.consts]
    inputs = [lowering.input(var.aval) for var in jaxpr.jaxpr.invars]
    outputs = lowering.equations(jaxpr.jaxpr, consts, inputs)
    return builder.program([_require_number(output) for output in outputs])


class _Table(NamedTuple):
    """A 1-D array: its length, and a function from an index to the number there."""

    length: int
    read: Callable[[int], int]


_Value = int | _Table


def _require_number(value: _Value) -> int:
    # Returns the number of an operation. Raises UnknownPrimitive for a table.
    if isinstance(value, _Table):
        raise UnknownPrimitive("a whole array is used as one number; index one number of the array")
    return value


class _Lowering:
    # Translates the equations of a jaxpr to operations of `builder`.

    def __init__(self, builder: Builder, functions: Functions):
        self.builder, self.functions = builder, functions
        self.types = (*TYPES, *WIDE_INTEGERS) if functions == "library" else TYPES

    def _dtype(self, aval) -> str:
        # Returns the name of a type. Raises UnknownPrimitive for an unsupported type.
        name = str(np.dtype(aval.dtype))
        if name not in self.types:
            expected = ", ".join(self.types)
            raise UnknownPrimitive(f"numbers of type {name} are not supported; expected {expected}")
        return name

    def input(self, aval: Any) -> _Value:
        # Adds an input of the program: a single number, or a table for a 1-D array. aval: its
        # abstract value in JAX, with shape and dtype.
        if len(aval.shape) > 1:
            raise UnknownPrimitive(f"an input has shape {aval.shape}; {_SMALL}")
        if aval.shape:
            table = self.builder.table(self._dtype(aval), aval.shape[0])
            return _Table(aval.shape[0], lambda index: self.builder.lookup(table, index))
        return self.builder.input(self._dtype(aval))

    def constant(self, value: Any) -> _Value:
        # Adds a constant: a single number, or a table of constants for a 1-D array.
        value = np.asarray(value)
        dtype = self._dtype(value)
        if value.size == 1:
            return self.builder.constant(dtype, value.reshape(()))
        if value.ndim != 1:
            raise UnknownPrimitive(f"a constant has shape {value.shape}; {_SMALL}")
        return _Table(len(value), lambda index: self._select_constant(dtype, value, index))

    def _select_constant(self, dtype: str, values: np.ndarray, index: int) -> int:
        # Emits the number at `index` of a table of constants, as a chain of selects.
        b, result = self.builder, self.builder.constant(dtype, values[0])
        for k, value in enumerate(values[1:], 1):
            is_index = b.emit("eq", "bool", index, b.constant("int32", k))
            result = b.emit("select", dtype, is_index, b.constant(dtype, value), result)
        return result

    def equations(
        self, jaxpr: core.Jaxpr, consts: Sequence[_Value], inputs: Sequence[_Value]
    ) -> list[_Value]:
        # Translates the equations of a jaxpr in order. Returns its results.
        values: dict[Any, _Value] = dict(zip(jaxpr.constvars, consts, strict=True))
        values.update(zip(jaxpr.invars, inputs, strict=True))

        def read(atom):
            if not hasattr(atom, "val"):
                return values[atom]
            # The atom is a constant in the equation.
            return self.constant(np.asarray(atom.val, np.dtype(atom.aval.dtype)))

        for eqn in jaxpr.eqns:
            operands = [read(atom) for atom in eqn.invars]
            name = eqn.primitive.name
            if name in _CALLS + _REMATERIALISED:
                # A jaxpr, or a closed jaxpr: an object with a jaxpr and its constants.
                callee: Any = eqn.params.get("jaxpr") or eqn.params["call_jaxpr"]
                constants = [self.constant(value) for value in getattr(callee, "consts", ())]
                results = self.equations(getattr(callee, "jaxpr", callee), constants, operands)
            elif name == "cond":
                results = self._both_branches(eqn, operands)
            elif name == "optimization_barrier":
                results = operands
            else:
                results = [self._equation(eqn, operands)]
            values.update(zip(eqn.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def _both_branches(self, eqn: core.JaxprEqn, operands: list[_Value]) -> list[_Value]:
        """Return the results of a `cond`: both branches are computed, and one result is selected.
        The first branch is the usual one, so the second may be skipped (see `regions`).
        """
        if (count := len(eqn.params["branches"])) != 2:
            raise UnknownPrimitive(f"a cond has {count} branches; expected 2 (nest several conds)")
        # Operand 0 of a `cond` is the number of the branch; the others are the branches' arguments.
        b, index = self.builder, _require_number(operands[0])
        condition = b.emit("ne", "bool", index, b.constant(b.operations[index].dtype, 0))
        usual, rare = (
            self.equations(branch.jaxpr, [self.constant(c) for c in branch.consts], operands[1:])
            for branch in eqn.params["branches"]
        )
        pairs = zip(map(_require_number, rare), map(_require_number, usual), strict=True)
        return [b.emit("rarely", b.operations[x].dtype, condition, x, y) for x, y in pairs]

    def _equation(self, eqn: core.JaxprEqn, operands: list[_Value]) -> int:
        # Emits one equation of the jaxpr. Returns the number of the operation that has its result.
        aval: Any = eqn.outvars[0].aval
        name = eqn.primitive.name
        # An array of one number, such as a slice of a table, counts as a number.
        if math.prod(aval.shape) != 1:
            got = f"the result of {name} has shape {aval.shape}"
            raise UnknownPrimitive(f"{got}; expected a single number")
        if name in ("dynamic_slice", "gather"):
            return self._lookup(eqn, operands)
        scalar_operands = [_require_number(operand) for operand in operands]
        return self._operation(eqn, self._dtype(aval), scalar_operands)

    def _operation(self, eqn: core.JaxprEqn, dtype: str, x: list[int]) -> int:
        # Emits the operations of one primitive of JAX on the operands `x`. Returns the result's
        # number. Raises UnknownPrimitive for other primitives.
        name, params, b = eqn.primitive.name, eqn.params, self.builder
        if name in _ALIASES:
            return x[0]
        if self.functions == "polynomials" and name in polynomials.FUNCTIONS:
            if dtype != "float32":
                raise UnknownPrimitive(f"{name} of {dtype} is not supported; expected float32")
            return polynomials.FUNCTIONS[name](polynomials.Arithmetic(b.emit, b.constant), *x)
        match name:
            case "gt" | "ge":
                return b.emit("lt" if name == "gt" else "le", dtype, x[1], x[0])
            case "rem" if dtype.startswith("float"):
                if self.functions == "library":
                    return b.emit("fmod", dtype, *x)
            case "round":
                if int(params["rounding_method"]) == 1:
                    return b.emit("round", dtype, x[0])
            case "square":
                return b.emit("mul", dtype, x[0], x[0])
            case "integer_pow":
                return _emit_power(b, dtype, x[0], params["y"])
            case "rsqrt":
                return b.emit("div", dtype, b.constant(dtype, 1.0), b.emit("sqrt", dtype, x[0]))
            case "sign":
                return _emit_sign(b, dtype, x[0])
            case "is_finite":
                source = b.operations[x[0]].dtype
                return b.emit("lt", "bool", b.emit("abs", source, x[0]), b.constant(source, np.inf))
            case "clamp":
                return b.emit("min", dtype, b.emit("max", dtype, x[0], x[1]), x[2])
            case "select_n" if len(x) == 3 and b.operations[x[0]].dtype == "bool":
                return b.emit("select", dtype, x[0], x[2], x[1])
            case _ if name in _RENAMED or name in semantics.MEANING:
                return b.emit(_RENAMED.get(name, name), dtype, *x)
            case _ if self.functions == "library" and name in semantics.LIBRARY:
                return b.emit(name, dtype, *x)
        raise UnknownPrimitive(
            f"primitive {name!r} of {dtype} {params.get('rounding_method', '')} is not supported;"
            " write the code with other operations on scalars"
        )

    def _lookup(self, eqn: core.JaxprEqn, operands: list[_Value]) -> int:
        """Return the number of a 1-D table at an index. Outside of the table, the result is the
        first or last number of the table, or NaN with JAX's mode `fill`.
        """
        # Operands: the table, the index. `slice_sizes`: numbers that are read along each axis.
        table, is_single = operands[0], tuple(eqn.params["slice_sizes"]) == (1,)
        if not isinstance(table, _Table) or len(operands) != 2 or not is_single:
            aval: Any = eqn.invars[0].aval
            name = f"{eqn.primitive.name} of shape {aval.shape}"
            raise UnknownPrimitive(f"{name} is not supported; read one item of a 1-D array")
        b = self.builder
        index = b.emit("convert", "int32", _require_number(operands[1]))
        first, last = b.constant("int32", 0), b.constant("int32", table.length - 1)
        clamped = b.emit("min", "int32", b.emit("max", "int32", index, first), last)
        result = table.read(clamped)
        mode = eqn.params.get("mode")
        if mode is None or mode != lax.GatherScatterMode.FILL_OR_DROP:
            return result
        dtype = b.operations[result].dtype
        if not dtype.startswith("float"):
            raise UnknownPrimitive(
                f"an array of {dtype} is read with mode 'fill', the default of jnp.take; write"
                " array.at[k].get(mode='clip')"
            )
        bounds = b.emit("le", "bool", first, index), b.emit("le", "bool", index, last)
        is_inside = b.emit("and", "bool", *bounds)
        return b.emit("select", dtype, is_inside, result, b.constant(dtype, np.nan))
