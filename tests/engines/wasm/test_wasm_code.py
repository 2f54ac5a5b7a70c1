"""WebAssembly gives the bits that each operation means, and a fused multiply-add those of a
product and a sum.
"""

from __future__ import annotations

import numpy as np
import pytest
from compiled_program import HARD_FLOATS, HARD_INTEGERS, lowered, pairs, same_bits
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("wasmtime", reason="wasmtime is not installed (pip install wasmtime)")
from wasm_program import wasm_results

from ravenjax.engines.wasm import code
from ravenjax.ir import semantics
from ravenjax.ir.builder import Builder
from ravenjax.numbers.lazy import jnp

WIDTHS = (1, code.WIDTH)
UNARY_FLOAT = ("neg", "abs", "sqrt", "floor", "ceil", "round")
BINARY_FLOAT = ("add", "sub", "mul", "div", "max", "min", "eq", "ne", "lt", "le")
BINARY_INTEGER = (*BINARY_FLOAT, "rem", "and", "or", "xor", "shl", "shr", "sar")
TRUTHS = ("eq", "ne", "lt", "le")


def programs(*wanted):
    """One program of several operations (name, dtype, types of its operands), whose inputs are
    shared by type.
    """
    builder, inputs = Builder(), {}

    def of(place, dtype):
        if (place, dtype) not in inputs:
            inputs[place, dtype] = builder.input(dtype)
        return inputs[place, dtype]

    results = [
        builder.emit(name, dtype, *(of(k, t) for k, t in enumerate(types)))
        for name, dtype, types in wanted
    ]
    return builder.program(results), list(inputs)


def check(width, wanted, columns):
    """columns: (place of the operand, type) -> values."""
    program, inputs = programs(*wanted)
    results = wasm_results(program, width, tuple(columns[key] for key in inputs))
    for (name, dtype, types), got in zip(wanted, results, strict=True):
        same_bits(
            got, semantics.evaluate(name, dtype, tuple(columns[k, t] for k, t in enumerate(types)))
        )


@pytest.mark.parametrize("width", WIDTHS)
def test_float_operations(width):
    a, b = pairs(HARD_FLOATS)
    wanted = [(name, "float32", ("float32",)) for name in UNARY_FLOAT]
    wanted += [
        (name, "bool" if name in TRUTHS else "float32", ("float32", "float32"))
        for name in BINARY_FLOAT
    ]
    check(width, wanted, {(0, "float32"): a, (1, "float32"): b})


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("dtype", ["int32", "uint32"])
def test_integer_operations_wrap(width, dtype):
    a, b = (x.view(dtype) for x in pairs(HARD_INTEGERS))
    names = [name for name in BINARY_INTEGER if (name, dtype) != ("sar", "uint32")]
    wanted = [(name, "bool" if name in TRUTHS else dtype, (dtype, dtype)) for name in names]
    wanted += [("neg", dtype, (dtype,)), ("not", dtype, (dtype,))] + [("abs", dtype, (dtype,))] * (
        dtype == "int32"
    )
    check(width, wanted, {(0, dtype): a, (1, dtype): b})


@pytest.mark.parametrize("width", WIDTHS)
def test_conversions(width):
    to = [("convert", dtype, ("float32",)) for dtype in ("int32", "uint32", "float64")]
    to += [("bitcast", dtype, ("float32",)) for dtype in ("int32", "uint32")] + [
        ("truncate", "int32", ("float32",))
    ]
    check(width, to, {(0, "float32"): HARD_FLOATS})
    for dtype in ("int32", "uint32"):
        back = [("convert", "float32", (dtype,)), ("bitcast", "float32", (dtype,))]
        check(width, back, {(0, dtype): HARD_INTEGERS.view(dtype)})


@pytest.mark.parametrize("width", WIDTHS)
def test_choices_and_truth_values(width):
    a, b = pairs(np.array([False, True]))
    columns = {(0, "bool"): a, (1, "bool"): b, (1, "int32"): np.array([3, 0, 1, 7], np.int32)}
    columns |= {
        (2, "int32"): np.array([0, 1, 5, 0], np.int32),
        (1, "float32"): np.float32([3, 0, np.nan, 0]),
    }
    columns |= {(2, "float32"): np.float32([0, 1, 1, -0.0])}
    wanted = [(name, "bool", ("bool", "bool")) for name in ("and", "or", "xor")] + [
        ("not", "bool", ("bool",))
    ]
    wanted += [("select", dtype, ("bool", dtype, dtype)) for dtype in ("int32", "float32")]
    check(width, wanted, columns)


@pytest.mark.parametrize("width", WIDTHS)
def test_look_ups(width):
    tables = np.concatenate([np.arange(5), 100 + np.arange(7)]).astype(np.float32)
    builder = Builder()
    first, second, index = (
        builder.table("float32", 5),
        builder.table("float32", 7),
        builder.input("int32"),
    )
    program = builder.program([builder.lookup(first, index), builder.lookup(second, index)])
    places = np.array([4, 0, 2, 2, 1, 3, 0, 4, 1], np.int32)
    got = wasm_results(program, width, (places,), tables)
    same_bits(got[0], places.astype(np.float32))
    same_bits(got[1], places.astype(np.float32) + 100)


FLOATS = st.floats(width=32, allow_nan=True, allow_infinity=True)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(FLOATS, FLOATS, FLOATS), min_size=4, max_size=64))
def test_a_multiply_add_is_a_product_and_a_sum_each_rounded(rows):
    a, b, c = np.array(rows, np.float32).T
    builder = Builder()
    program = builder.program(
        [builder.emit("fma", "float32", *(builder.input("float32") for _ in range(3)))]
    )
    (got,) = wasm_results(program, code.WIDTH, (a, b, c))
    product = semantics.evaluate("mul", "float32", (a, b))
    same_bits(got, semantics.evaluate("add", "float32", (product, c)))


@pytest.mark.parametrize("width", WIDTHS)
def test_functions_are_within_an_ulp_or_two_of_numpys(width):
    x = np.linspace(-3, 3, 500, dtype=np.float32)
    y = np.linspace(2, -5, 500, dtype=np.float32)
    sine, cosine, angle, root = wasm_results(
        lowered(lambda a, b: (jnp.sin(a), jnp.cos(a), jnp.arctan2(a, b), jnp.exp(b)), x, y),
        width,
        (x, y),
    )
    wide_x, wide_y = x.astype(np.float64), y.astype(np.float64)
    for got, right in (
        (sine, np.sin(wide_x)),
        (cosine, np.cos(wide_x)),
        (angle, np.arctan2(wide_x, wide_y)),
        (root, np.exp(wide_y)),
    ):
        np.testing.assert_allclose(got, right, rtol=1e-6, atol=2e-7)
