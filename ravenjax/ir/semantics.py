"""Defines the result of each operation of a program, in NumPy.

The definitions are used to fold constants and to test generated code. Floats follow IEEE 754, with
one rounding per operation, including `fma`. Integers wrap. No operation raises an error. Edge cases
follow XLA where it defines them:

- A conversion from float to integer saturates, and NaN becomes 0. `truncate` instead follows C's
  `(int)x` on x86: a number that does not fit becomes -2147483648.
- A shift by the width of the number, or by more, shifts all bits out.
- Division of an integer by 0 gives -1.
- `max` and `min` of NaN and a number return NaN; of +0 and -0 they return the second operand.

`rarely` gives the same result as `select` (`regions` explains it). Functions such as the sine are
those of the C library, rounded to their type.
"""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax import resources
from ravenjax.ir.program import Operation, Program

Array = Any


def evaluate_operation(name: str, dtype: str, operands: tuple[Array, ...]) -> Array:
    """Return the result of an operation of type `dtype` on numbers or arrays of one shape."""
    with np.errstate(all="ignore"):
        return _result(name, dtype, *operands)


def _result(name: str, dtype: str, *operands: Array) -> Array:
    # Computes an operation; callers silence NumPy. [()] makes a number of an array without axes.
    if name in ("convert", "bitcast"):
        x = np.asarray(operands[0])
        return (_convert(x, np.dtype(dtype)) if name == "convert" else x.view(dtype))[()]
    if name == "div" and np.dtype(dtype).kind in "iu":
        return _divide_integers(*operands)
    return np.asarray(_FUNCTIONS[name](*operands)).astype(dtype)[()]


def run_program(program: Program, inputs: Sequence[Any], tables: Sequence[Array] = ()) -> list[Any]:
    """Return the results of `program`. inputs: NumPy numbers, or arrays of one shape."""

    def apply(operation: Operation, *operands):
        name, dtype, _, detail = operation
        if name == "input":
            return np.asarray(inputs[detail], dtype)[()]
        if name == "constant":
            return operation.value
        return tables[detail][operands[0]] if name == "lookup" else _result(name, dtype, *operands)

    with np.errstate(all="ignore"):
        return program.replay(apply)


def fma(a: Array, b: Array, c: Array) -> Array:
    """Return a b + c rounded once.

    float64 is computed in long double, whose 64 bits of mantissa keep the result within (1/2 +
    2^-11) ulp. float32 is computed in float64 and then rounded. Two roundings to nearest could give
    another float32 than one. So the float64 sum is rounded to odd: of the two float64 numbers next
    to an inexact sum, it is the one whose last bit is 1.
    """
    if np.asarray(a).dtype == np.float64:
        return np.float64(np.longdouble(a) * np.longdouble(b) + np.longdouble(c))
    product = np.float64(a) * np.float64(b)  # exact: 48 bits
    total = product + np.float64(c)
    # What the rounding of `total` removed is, exactly, `error` (Knuth's two-sum).
    rest = total - product
    error = (product - (total - rest)) + (np.float64(c) - rest)
    bits = total.view(np.int64)
    is_inexact_and_even = np.isfinite(total) & (error != 0.0) & (bits & 1 == 0)
    # The exact sum is between `total` and this neighbour. bits + 1: the next number away from 0.
    odd_neighbour = np.where((error > 0.0) == (total > 0.0), bits + 1, bits - 1)
    to_odd = np.where(is_inexact_and_even, odd_neighbour, bits)
    return to_odd.view(np.float64).astype(np.float32)[()]


def _divide_integers(a: Array, b: Array) -> Array:
    # Divides integers, rounded toward zero as in C. Division by 0 gives -1, as in XLA.
    wide_a, wide_b = np.int64(a), np.int64(b)
    magnitude = np.abs(wide_a) // np.where(wide_b == 0, 1, np.abs(wide_b))
    quotient = np.where((wide_a < 0) == (wide_b < 0), magnitude, -magnitude)
    return np.where(wide_b == 0, -1, quotient).astype(a.dtype)[()]


def _integer_remainder(a: Array, b: Array) -> Array:
    return np.int64(a) - np.where(
        np.int64(b) == 0, 0, np.int64(_divide_integers(a, b)) * np.int64(b)
    )


def _convert(x: Array, dtype: np.dtype) -> Array:
    # Converts numbers to another type. Floats saturate at an integer's ends, and NaN becomes 0.
    if dtype.kind == "b":
        return x != 0
    if x.dtype.kind == "f" and dtype.kind in "iu":
        integers = np.iinfo(dtype)
        # The power of two above the largest integer, which may not be a float64 (2^63 - 1 is none).
        # One bit of a signed integer is its sign.
        limit = 2.0 ** (integers.bits - (dtype.kind == "i"))
        number = np.where(np.isnan(x), 0.0, x).astype(np.float64)
        clipped = np.clip(number, float(integers.min), np.nextafter(limit, 0.0))
        return np.where(number < limit, clipped.astype(dtype), integers.max)
    return x.astype(dtype)


def _truncate(x: Array) -> Array:
    # Converts floats to int32 as C does on x86: what does not fit becomes the smallest int32.
    fits = (x >= -2147483648.0) & (x < 2147483648.0)
    return np.where(fits, np.where(fits, x, 0.0).astype(np.float64), -2147483648.0).astype(np.int32)


def _larger_or_smaller(is_first: Callable[[Array, Array], Array]):
    # Returns max or min: `a` where `is_first(a, b)` or where a is NaN, else b.
    return lambda a, b: np.where((a != a) | is_first(a, b), a, b)


def _define_shift(shift: Callable[[Array, Array], Array], fill: Callable[[Array], Array]):
    # Returns a shift whose result is `fill(x)` if the amount is the width of x or more.
    def shifted(x: Array, amount: Array):
        # As uint32, a negative amount is also too large.
        inside = amount.astype(np.uint32) < x.dtype.itemsize * 8
        return np.where(inside, shift(x, np.where(inside, amount, 0).astype(x.dtype)), fill(x))

    return shifted


def _shift_right_logical(x: Array, by: Array) -> Array:
    unsigned = np.dtype(f"u{x.dtype.itemsize}")
    return (x.view(unsigned) >> by.astype(unsigned)).view(x.dtype)


MEANING: dict[str, Callable[..., Array]] = {
    **{
        name: getattr(np, function)
        for name, function in resources.read_tables(__file__, "semantics.toml").items()
    },
    "rem": _integer_remainder,
    "fma": fma,
    "max": _larger_or_smaller(np.greater),
    "min": _larger_or_smaller(np.less),
    "shl": _define_shift(np.left_shift, np.zeros_like),
    "shr": _define_shift(_shift_right_logical, np.zeros_like),
    "sar": _define_shift(np.right_shift, lambda x: np.where(x < 0, -1, 0)),
    "truncate": _truncate,
}
"""Operations by name, without `convert`, `bitcast` and those of `LIBRARY`."""

_C_LIBRARY = ctypes.CDLL(None)


def _library_function(name: str, arguments: int):
    # Returns a function of the C library, of float64 numbers, applied to each number of an array.
    function = getattr(_C_LIBRARY, name)
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * arguments
    return np.frompyfunc(function, arguments, 1)


_UNARY = ("sin", "cos", "tan", "asin", "acos", "atan", "tanh", "exp", "expm1", "log", "log1p")
LIBRARY: dict[str, Callable[..., Array]] = {
    **{name: _library_function(name, 1) for name in _UNARY},
    **{name: _library_function(name, 2) for name in ("atan2", "fmod", "pow")},
}
"""Functions of the C library, by JAX's names of the operations (except `fmod`)."""
_FUNCTIONS = MEANING | LIBRARY
