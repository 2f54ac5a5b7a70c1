"""A program comes back from its bytes as it was."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.ir import binary
from ravenjax.ir.builder import Builder

CONSTANTS = st.sampled_from(
    [
        ("float32", np.nan),
        ("float32", -0.0),
        ("float64", -np.inf),
        ("float64", 0.1),
        ("int32", -(2**31)),
        ("uint32", 2**32 - 1),
        ("int64", -1),
        ("uint64", 2**64 - 1),
        ("bool", True),
    ]
)


@st.composite
def programs(draw):
    builder = Builder()
    numbers = [builder.input("float32") for _ in range(draw(st.integers(1, 3)))]
    table = builder.table("float32", draw(st.integers(1, 9)))
    for _ in range(draw(st.integers(0, 12))):
        kind = draw(st.sampled_from(["constant", "lookup", "add", "fma"]))
        pick = [draw(st.sampled_from(numbers)) for _ in range(3)]
        if kind == "constant":
            builder.constant(*draw(CONSTANTS))
        elif kind == "lookup":
            numbers.append(builder.lookup(table, builder.emit("convert", "int32", pick[0])))
        else:
            numbers.append(builder.emit(kind, "float32", *pick[: 2 if kind == "add" else 3]))
    return builder.program([draw(st.sampled_from(numbers)) for _ in range(draw(st.integers(0, 4)))])


@given(programs())
def test_a_program_comes_back(program):
    assert binary.from_bytes(binary.to_bytes(program)) == program


def test_origins_are_left_behind():
    builder = Builder()
    builder.origin = "a stage"
    program = builder.program([builder.emit("neg", "float32", builder.input("float32"))])
    again = binary.from_bytes(binary.to_bytes(program))
    assert again == dataclasses.replace(program, origins=("", ""))


@pytest.mark.parametrize("content", [b"", b"{}", b'{"names": [', b"\x00\xff"])
def test_anything_else_is_refused(content):
    with pytest.raises((ValueError, KeyError)):
        binary.from_bytes(content)


def test_a_program_cut_short_is_refused():
    builder = Builder()
    content = binary.to_bytes(
        builder.program([builder.emit("neg", "float32", builder.input("float32"))])
    )
    with pytest.raises(ValueError):
        binary.from_bytes(content[:-1])
