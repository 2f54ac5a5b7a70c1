"""Printed straight-line code against NumPy, bit by bit, and its refusals."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from ravenjax.engines.cpu import python
from ravenjax.ir.lowering import UnknownPrimitive

VALUES = [0.0, -0.0, 1.0, -1.5, 2.5, 3.5, 1e-3, math.pi, 1e30, -1e30, math.inf, -math.inf, math.nan]
INTEGERS = [0, 1, -1, 7, -7, 2**31 - 1, -(2**31), 65535, 123456789]


def printed(function, *types):
    with jax.enable_x64(True):
        shapes = [
            t if isinstance(t, jax.ShapeDtypeStruct) else jax.ShapeDtypeStruct((), t) for t in types
        ]
        return python.compile(jax.make_jaxpr(function)(*shapes))


def call(function, *arguments):
    return function(function.represent(arguments))[0]


def same(a, b):
    return (a != a and b != b) or (a == b and math.copysign(1, a) == math.copysign(1, b))


ARITHMETIC = {
    "add": (lambda a, b: a + b, np.add),
    "sub": (lambda a, b: a - b, np.subtract),
    "mul": (lambda a, b: a * b, np.multiply),
    "div": (lambda a, b: a / b, np.divide),
    "max": (jnp.maximum, np.maximum),
    "min": (jnp.minimum, np.minimum),
    "rem": (lax.rem, np.fmod),
}


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", list(ARITHMETIC))
def test_arithmetic_is_one_ieee_operation(name, dtype):
    traced, reference = ARITHMETIC[name]
    function = printed(traced, dtype, dtype)
    with np.errstate(all="ignore"):
        for a in VALUES:
            for b in VALUES:
                expected = reference(dtype(a), dtype(b))
                got = call(function, a, b)
                zeros = (
                    name in ("max", "min") and got == expected == 0
                )  # IEEE leaves the sign of such a zero open
                assert same(float(got), float(expected)) or zeros, (name, a, b)


UNARY = {
    "neg": (lambda x: -x, np.negative),
    "abs": (jnp.abs, np.abs),
    "sqrt": (jnp.sqrt, np.sqrt),
    "floor": (jnp.floor, np.floor),
    "round": (jnp.round, np.round),
    "sign": (jnp.sign, np.sign),
    "square": (lambda x: x**2, np.square),
    "cube": (lambda x: x**3, lambda x: x * x * x),
    "inverse": (lambda x: x**-1, lambda x: 1 / x),
    "exp": (jnp.exp, None),
    "log": (jnp.log, None),
    "sin": (jnp.sin, None),
    "cos": (jnp.cos, None),
    "acos": (lax.acos, None),
    "asin": (lax.asin, None),
    "tanh": (jnp.tanh, None),
}


@pytest.mark.parametrize("name", list(UNARY))
def test_functions_of_one_number(name):
    traced, reference = UNARY[name]
    function = printed(traced, np.float64)
    with np.errstate(all="ignore"):
        for x in VALUES:
            got = call(function, x)
            if reference is not None:
                expected = float(reference(np.float64(x)))
                assert same(got, expected) or (name == "sign" and got == expected == 0), x
                continue
            expected = float(
                {"acos": np.arccos, "asin": np.arcsin}.get(name, getattr(np, name, None))(x)
            )
            assert same(got, expected) or got == pytest.approx(expected, rel=4e-16), x


def test_float32_functions_are_rounded_to_float32():
    function = printed(lambda x: jnp.sin(x) * 2, np.float32)
    got = call(function, 1.1)
    assert type(got) is np.float32
    assert got == np.float32(math.sin(np.float32(1.1))) * np.float32(2)


def test_atan2_of_all_quadrants_and_zeros():
    function = printed(jnp.arctan2, np.float64, np.float64)
    for y in VALUES:
        for x in VALUES:
            assert same(call(function, y, x), math.atan2(y, x))


def test_a_product_and_a_sum_are_rounded_apart():
    function = printed(lambda a, b, c: a * b + c, np.float64, np.float64, np.float64)
    a, b = 1.0 + 2.0**-30, 1.0 - 2.0**-30
    assert call(function, a, b, -1.0) == a * b - 1.0 == 0.0  # contracted, it is -2^-60


INTEGER = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "and": lambda a, b: a & b,
    "or": lambda a, b: a | b,
    "xor": lambda a, b: a ^ b,
    "div": lax.div,
    "rem": lax.rem,
    "shift_left": lambda a, b: a << (b & 15),
    "shift_right_arithmetic": lambda a, b: a >> (b & 15),
    "shift_right_logical": lambda a, b: lax.shift_right_logical(a, b & 15),
    "abs": lambda a, b: jnp.abs(a),
    "not": lambda a, b: ~a,
    "less": lambda a, b: a < b,
}


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.int32, np.uint32])
@pytest.mark.parametrize("name", list(INTEGER))
def test_integers_wrap_as_xla_does(name, dtype):
    function = printed(INTEGER[name], dtype, dtype)
    for a in INTEGERS:
        for b in INTEGERS:
            if name in ("div", "rem") and (b == 0 or (a, b) == (-(2**31), -1)):
                continue
            x, y = (python.represent(np.dtype(dtype), v) for v in (a, b))
            expected = INTEGER[name](jnp.asarray(x, dtype), jnp.asarray(y, dtype))
            assert call(function, a, b) == expected.item(), (name, a, b)


def test_conversions_truncate_saturate_and_round():
    to_integer = printed(lambda x: lax.convert_element_type(x, jnp.int32), np.float64)
    assert [call(to_integer, x) for x in (2.9, -2.9, 1e20, -1e20, math.nan)] == [
        2,
        -2,
        2**31 - 1,
        -(2**31),
        0,
    ]
    to_single = printed(lambda x: lax.convert_element_type(x, jnp.float32), np.float64)
    assert call(to_single, 0.1) == np.float32(0.1)
    widened = printed(lambda x: lax.convert_element_type(x, jnp.float64), np.float32)
    assert call(widened, np.float32(0.1)) == float(np.float32(0.1))


def test_a_table_is_read_at_one_index_within_its_ends():
    table = jnp.array([10.0, 11.0, 12.0])
    shape = jax.ShapeDtypeStruct((3,), np.float32)
    function = printed(lambda t, i: lax.dynamic_slice(t, (i,), (1,))[0], shape, np.int32)
    run = function.represent
    assert [function(run([table, i]))[0] for i in (-5, 0, 2, 9)] == [10, 10, 12, 12]
    taken = printed(lambda i: jnp.array([1.0, 2.0, 4.0])[i], np.int32)
    assert [call(taken, i) for i in (0, 2)] == [1.0, 4.0]


def test_equal_and_dead_expressions_and_constants_vanish():
    def wasteful(x):
        dead = jnp.sin(x) * 7  # noqa: F841
        folded = jnp.cos(jnp.float64(0.0)) + 1.0
        return jax.jit(lambda y: y * y)(x) + x * x * folded

    assert printed(wasteful, np.float64).operations == 3


def test_an_unknown_primitive_is_refused_by_name():
    with pytest.raises(UnknownPrimitive, match="lgamma"):
        printed(lax.lgamma, np.float64)
    with pytest.raises(UnknownPrimitive, match=r"shape \(3,\)"):
        printed(lambda x: jnp.zeros(3) + x, np.float64)
    with pytest.raises(UnknownPrimitive, match="while"):
        printed(lambda x: lax.while_loop(lambda v: v < 3, lambda v: v + 1, x), np.float64)
