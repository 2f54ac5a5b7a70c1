"""Compiled code gives the bits that each operation means, at every vector width."""

import numpy as np
import pytest
from compiled_program import HARD_FLOATS, compiled, pairs, same_bits
from operation_cases import CASES, FUSED, case, look_ups

from ravenjax.engines.cpu import jit
from ravenjax.errors import UserError
from ravenjax.ir import semantics


@pytest.mark.parametrize("width", [1, 4, 8, 16])
def test_every_operation_gives_the_bits_that_it_means(width):
    wide = case("convert", "float32", HARD_FLOATS.astype(np.float64) * 1.0000001)
    for one in (*CASES, *FUSED, case("convert", "float64", HARD_FLOATS), wide):
        (expected,) = semantics.run_program(one.program, one.columns)
        same_bits(compiled(one.program, width, one.columns)[0], np.asarray(expected))


@pytest.mark.parametrize("width", [1, 4, 8, 16])
def test_look_ups(width):
    program, places, tables, expected = look_ups()
    for got, right in zip(compiled(program, width, (places,), tables), expected, strict=True):
        same_bits(got, right)


def test_float64_has_half_the_lanes_but_all_operations():
    columns = tuple(x.astype(np.float64) for x in pairs(HARD_FLOATS))
    for name in ("add", "mul", "div", "max", "lt"):
        one = case(name, "bool" if name == "lt" else "float64", *columns)
        same_bits(
            compiled(one.program, 8, columns)[0], semantics.run_program(one.program, columns)[0]
        )


def test_a_cpu_without_fused_multiply_add_is_refused(monkeypatch):
    monkeypatch.setattr(jit.llvm, "get_host_cpu_features", lambda: {"avx": True, "fma": False})
    with pytest.raises(UserError, match="expected x86-64-v3"):
        jit.host_target.__wrapped__()
