"""Transitions: compiled ones have the bits of interpreted ones, and functions are those of the C
library.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import HARD_FLOATS
from hypothesis import given, settings
from hypothesis import strategies as st
from jax import lax

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.memory import BufferLayout, aligned_buffer
from ravenjax.engines.cpu.transition import (
    EMPTY,
    Compiled,
    Interpreted,
    Memory,
    StateTransition,
    print_module,
)
from ravenjax.engines.traced import trace_function
from ravenjax.ir.semantics import LIBRARY
from ravenjax.numbers.vec import if_rarely, to_int32

FUNCTIONS = {
    "sin": jnp.sin,
    "cos": jnp.cos,
    "tan": jnp.tan,
    "asin": lax.asin,
    "acos": lax.acos,
    "atan": lax.atan,
    "tanh": jnp.tanh,
    "exp": jnp.exp,
    "expm1": jnp.expm1,
    "log": jnp.log,
    "log1p": jnp.log1p,
    "atan2": jnp.arctan2,
    "pow": jnp.power,
    "fmod": lax.rem,
}


def both(function, state, entering):
    """`function`(state, *entering) -> (state, leaving), compiled and interpreted: what a run of
    some rows gives.
    """
    columns = [np.asarray(column) for column in entering]
    types = [str(column.dtype) for column in columns]
    with jax.enable_x64(True):
        shapes = [jax.ShapeDtypeStruct((), dtype) for dtype in (str(state.dtype), *types)]
        program, _ = trace_function(function, *shapes, functions="library")
        own = BufferLayout.aligned([str(state.dtype)])
        one = StateTransition(program, EMPTY, own, BufferLayout.aligned(types))
        results = []
        for machine in (Compiled(print_module({"f": one}), "f"), Interpreted({"f": one})):
            steps = len(columns[0])
            rooms = ((EMPTY, 1), (own, 1), (one.step_inputs, steps), (one.step_outputs, steps))
            memory = Memory(*(aligned_buffer(n, layout.bytes) for layout, n in rooms))
            transition.write_row(own, memory.state[0], [state])
            for row, numbers in zip(memory.step_inputs, zip(*columns, strict=True), strict=True):
                transition.write_row(one.step_inputs, row, numbers)
            memory = memory._replace(fixed=memory.fixed[0], state=memory.state[0])
            machine.bind("f", memory)()
            results.append(
                (
                    transition.read_row(own, memory.state),
                    [transition.read_row(one.step_outputs, row) for row in memory.step_outputs],
                )
            )
    return results


def same(compiled, interpreted):
    np.testing.assert_array_equal(np.array(compiled[0]), np.array(interpreted[0]))
    for a, b in zip(zip(*compiled[1], strict=True), zip(*interpreted[1], strict=True), strict=True):
        a, b = np.array(a), np.array(b)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
        if a.dtype.kind == "f":
            np.testing.assert_array_equal(np.signbit(a)[a == 0], np.signbit(b)[b == 0])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", list(FUNCTIONS))
def test_functions_are_those_of_the_c_library(name, dtype):
    rng = np.random.default_rng(1)
    small, far = (
        rng.normal(0, 2, 1000),
        rng.normal(0, 1, 1000) * 10.0 ** rng.integers(-12, 12, 1000),
    )
    x = np.concatenate([HARD_FLOATS, small, far]).astype(dtype)
    two = name in ("atan2", "pow", "fmod")
    entering = (x, rng.permutation(x)) if two else (x,)
    compiled, interpreted = both(lambda s, *x: (s, FUNCTIONS[name](*x)), np.float64(0), entering)
    same(compiled, interpreted)
    known = LIBRARY[name]
    for row, (y,) in zip(zip(*entering, strict=True), compiled[1], strict=True):
        with np.errstate(all="ignore"):
            expected = dtype(known(*map(float, row)))
        assert y == expected or (math.isnan(y) and math.isnan(expected)), (row, y, expected)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.floats(), st.floats(), st.floats()), min_size=1, max_size=5))
def test_a_product_and_a_sum_are_rounded_apart_and_a_state_is_carried_on(rows):
    def mixed(state, a, b, c):
        total = a * b + c
        narrow = lax.convert_element_type(total, jnp.float32)
        kept = jnp.where(total > 0, state + total, -state * c)
        return (
            kept,
            narrow * narrow + narrow,
            to_int32(total * 1e6),
            jnp.maximum(a, b),
            total - a * b,
        )

    compiled, interpreted = both(mixed, np.float64(0.1), np.array(rows).T)
    same(compiled, interpreted)
    a, b, c = np.array(rows[0])
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(compiled[1][0][3], a * b + c - a * b)


def test_what_is_rare_is_computed_where_it_is_asked_for():
    def often(state, x):
        def rare():
            y = x
            for _ in range(12):
                y = jnp.sin(y) * 1.25 + y
            return y

        return state + 1.0, if_rarely(x > 0.9, rare, x)

    compiled, interpreted = both(often, np.float64(0), (np.random.default_rng(2).random(400),))
    same(compiled, interpreted)
    assert compiled[0] == [400.0]


def test_wide_integers_are_wrapped_and_widened():
    def wide(state, x, y):
        longer = lax.convert_element_type(x, jnp.int64) * 3 - 1
        chosen = jnp.where(longer > lax.convert_element_type(y, jnp.int64), longer, -longer)
        return (
            state,
            lax.convert_element_type(chosen, jnp.int32),
            lax.convert_element_type(chosen, jnp.float64),
        )

    x = np.array([0, 1, -1, 2**31 - 1, -(2**31), 123456789], np.int32)
    same(*both(wide, np.float64(0), (x, x[::-1].copy())))
