"""Programs of one operation each, with numbers that are hard for it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from compiled_program import HARD_FLOATS, HARD_INTEGERS, pairs

from ravenjax.ir import polynomials
from ravenjax.ir.builder import Builder
from ravenjax.ir.program import Program

FLOAT_PAIRS = pairs(HARD_FLOATS)
TRUTHS = pairs(np.array([False, True]))
COMPARED = ("eq", "ne", "lt", "le")
OF_FLOATS = ("add", "sub", "mul", "div", "max", "min", *COMPARED)


class Case(NamedTuple):
    """A program and its inputs."""

    name: str
    program: Program
    columns: tuple[np.ndarray, ...]


def case(name: str, dtype: str, *columns: np.ndarray) -> Case:
    """One operation of inputs."""
    builder, types = Builder(), [str(column.dtype) for column in columns]
    program = builder.program([builder.emit(name, dtype, *map(builder.input, types))])
    return Case(f"{name}_{dtype}_{types[0]}", program, columns)


def _cases() -> Iterator[Case]:
    for name in ("neg", "abs", "sqrt", "floor", "ceil", "round"):
        yield case(name, "float32", HARD_FLOATS)
    for name in OF_FLOATS:
        yield case(name, "bool" if name in COMPARED else "float32", *FLOAT_PAIRS)
    for dtype in ("int32", "uint32"):
        integers = HARD_INTEGERS.view(dtype)
        shifts = ("shl", "shr", "sar") if dtype == "int32" else ("shl", "shr")
        for name in (*OF_FLOATS, "rem", "and", "or", "xor", *shifts):
            yield case(name, "bool" if name in COMPARED else dtype, *pairs(integers))
        for name in ("neg", "not"):
            yield case(name, dtype, integers)
        yield case("convert", dtype, HARD_FLOATS)
        yield case("convert", "float32", integers)
        yield case("bitcast", dtype, HARD_FLOATS)
        yield case("bitcast", "float32", HARD_FLOATS.view(dtype))
    yield case("abs", "int32", HARD_INTEGERS)
    yield case("bitcast", "uint32", HARD_INTEGERS)
    yield case("truncate", "int32", HARD_FLOATS)
    for name in ("and", "or", "xor"):
        yield case(name, "bool", *TRUTHS)
    yield case("not", "bool", TRUTHS[0])
    for columns in (FLOAT_PAIRS, pairs(HARD_INTEGERS), TRUTHS):
        condition = np.arange(len(columns[0])) % 3 == 0
        yield case("select", str(columns[0].dtype), condition, *columns)
    for name in ("max", "min"):
        for value in (0.0, -0.0, 1.5, np.inf, -3e38, np.nan):
            builder = Builder()
            constant, x = builder.constant("float32", value), builder.input("float32")
            program = builder.program([builder.emit(name, "float32", constant, x)])
            yield Case(f"{name}_of_{value}", program, (HARD_FLOATS,))
    for name in ("shl", "shr", "sar"):
        for amount in (0, 1, 16, 31, 32, 40):
            builder = Builder()
            x, by = builder.input("int32"), builder.constant("int32", amount)
            program = builder.program([builder.emit(name, "int32", x, by)])
            yield Case(f"{name}_by_{amount}", program, (HARD_INTEGERS,))
    angles = np.concatenate(
        [HARD_FLOATS, np.linspace(-40, 40, 999), np.geomspace(1e-30, 1e30, 500)]
    )
    for name in polynomials.FUNCTIONS:
        builder = Builder()
        columns = FLOAT_PAIRS if name == "atan2" else (angles.astype(np.float32),)
        arithmetic = polynomials.Arithmetic(builder.emit, builder.constant)
        inputs = [builder.input("float32") for _ in columns]
        program = builder.program([polynomials.FUNCTIONS[name](arithmetic, *inputs)])
        yield Case(name, program, columns)


def _fused() -> Iterator[Case]:
    a, b = FLOAT_PAIRS
    yield case("fma", "float32", a, b, np.roll(a, 5))
    rng = np.random.default_rng(1)
    x, y, z = (rng.standard_normal((3, 4000)) * 10.0 ** rng.integers(-6, 6, (3, 4000))).astype("f4")
    z[:1000] = -(x * y)[:1000]  # what a product and a sum would make 0
    yield case("fma", "float32", x, y, z)


CASES, FUSED = list(_cases()), list(_fused())
"""Those that every target has, and multiply-adds that are rounded once."""


def look_ups() -> tuple[Program, np.ndarray, np.ndarray, list[np.ndarray]]:
    """Two tables read at one index: program, indices, both tables one after the other, results."""
    builder = Builder()
    first, second = builder.table("float32", 5), builder.table("float32", 7)
    index = builder.input("int32")
    program = builder.program([builder.lookup(first, index), builder.lookup(second, index)])
    places = np.array([4, 0, 2, 2, 1, 3, 0, 4, 1, 1, 2, 3, 4, 0, 0, 1, 2], np.int32)
    tables = np.concatenate([np.arange(5), 100 + np.arange(7)]).astype(np.float32)
    return program, places, tables, [tables[places], tables[5 + places]]
