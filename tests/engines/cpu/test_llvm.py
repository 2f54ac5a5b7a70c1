"""Compiled code gives the bits that each operation means, at every vector width."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_program import HARD_FLOATS, HARD_INTEGERS, compiled, pairs, same_bits

from ravenjax.ir import semantics
from ravenjax.ir.builder import Builder

WIDTHS = (1, 4, 8, 16)
UNARY_FLOAT = ("neg", "abs", "sqrt", "floor", "ceil", "round")
BINARY_FLOAT = ("add", "sub", "mul", "div", "max", "min", "eq", "ne", "lt", "le")
BINARY_INTEGER = (*BINARY_FLOAT, "rem", "and", "or", "xor", "shl", "shr", "sar")
TRUTHS = ("eq", "ne", "lt", "le")


def one_operation(name, dtype, *types):
    builder = Builder()
    return builder.program([builder.emit(name, dtype, *(builder.input(t) for t in types))])


def check(width, name, dtype, *columns):
    program = one_operation(name, dtype, *(str(c.dtype) for c in columns))
    (got,) = compiled(program, width, columns)
    same_bits(got, semantics.evaluate(name, dtype, columns))


@pytest.mark.parametrize("width", WIDTHS)
def test_float_operations(width):
    a, b = pairs(HARD_FLOATS)
    for name in UNARY_FLOAT:
        check(width, name, "float32", HARD_FLOATS)
    for name in BINARY_FLOAT:
        check(width, name, "bool" if name in TRUTHS else "float32", a, b)


@pytest.mark.parametrize("width", WIDTHS)
def test_fused_multiply_add_rounds_once(width):
    rng = np.random.default_rng(1)
    scale = 10.0 ** rng.integers(-6, 6, (3, 4000))
    a, b, c = (rng.standard_normal((3, 4000)) * scale).astype(np.float32)
    c[:1000] = -(a * b)[:1000]  # what a product and a sum would make 0
    check(width, "fma", "float32", a, b, c)
    x, y = pairs(HARD_FLOATS)
    check(width, "fma", "float32", x, y, np.roll(x, 5))


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("dtype", ["int32", "uint32"])
def test_integer_operations_wrap(width, dtype):
    a, b = (x.view(dtype) for x in pairs(HARD_INTEGERS))
    for name in BINARY_INTEGER:
        if (name, dtype) != ("sar", "uint32"):
            check(width, name, "bool" if name in TRUTHS else dtype, a, b)
    if dtype == "int32":
        check(width, "abs", dtype, a)
    check(width, "neg", dtype, a)
    check(width, "not", dtype, a)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("amount", [0, 1, 16, 31, 32, 40])
def test_shifts_by_a_known_amount(width, amount):
    for name in ("shl", "shr", "sar"):
        builder = Builder()
        x = builder.input("int32")
        program = builder.program(
            [builder.emit(name, "int32", x, builder.constant("int32", amount))]
        )
        (got,) = compiled(program, width, (HARD_INTEGERS,))
        same_bits(
            got,
            semantics.evaluate(name, "int32", (HARD_INTEGERS, np.full_like(HARD_INTEGERS, amount))),
        )


@pytest.mark.parametrize("width", WIDTHS)
def test_conversions(width):
    for dtype in ("int32", "uint32"):
        check(width, "convert", dtype, HARD_FLOATS)
        check(width, "convert", "float32", HARD_INTEGERS.view(dtype))
        check(width, "bitcast", dtype, HARD_FLOATS)
    check(width, "truncate", "int32", HARD_FLOATS)
    check(width, "bitcast", "float32", HARD_FLOATS.view(np.int32))
    check(width, "convert", "float64", HARD_FLOATS)
    check(width, "convert", "float32", HARD_FLOATS.astype(np.float64) * 1.0000001)


@pytest.mark.parametrize("width", WIDTHS)
def test_truth_values(width):
    a, b = pairs(np.array([False, True]))
    for name in ("and", "or", "xor"):
        check(width, name, "bool", a, b)
    check(width, "not", "bool", a)
    for dtype in ("float32", "int32", "bool"):
        x, y = (np.array([3, 0, 1, 0], dtype), np.array([0, 1, 1, 0], dtype))
        check(width, "select", dtype, a, x, y)


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
    index = np.array([4, 0, 2, 2, 1, 3, 0, 4, 1, 1, 2, 3, 4, 0, 0, 1, 2], np.int32)
    got = compiled(program, width, (index,), tables)
    same_bits(got[0], index.astype(np.float32))
    same_bits(got[1], index.astype(np.float32) + 100)


def test_float64_has_half_the_lanes_but_all_operations():
    a, b = (x.astype(np.float64) for x in pairs(HARD_FLOATS))
    for name in ("add", "mul", "div", "max", "lt"):
        check(8, name, "bool" if name in TRUTHS else "float64", a, b)


def test_an_operation_without_a_form_is_refused_by_name():
    with pytest.raises(NotImplementedError, match="'frobnicate' of float32"):
        compiled(one_operation_unchecked("frobnicate"), 4, (HARD_FLOATS,))


def one_operation_unchecked(name):
    from ravenjax.ir.program import Operation, Program

    return Program(
        (Operation("input", "float32", (), 0), Operation(name, "float32", (0,))), ("float32",), (1,)
    )
