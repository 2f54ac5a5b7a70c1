"""Regions hold exactly what nobody else reads, stand before they are read, and passing them by
changes no bit.
"""

from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import same_bits
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.engines.cpu import jit
from ravenjax.engines.cpu.code import LaneCourse, VectorCode
from ravenjax.engines.cpu.kernel import print_kernel
from ravenjax.engines.lanes import Lanes
from ravenjax.ir import lowering, regions, semantics
from ravenjax.ir.builder import Builder, contract_to_fma
from ravenjax.ir.regions import Region, arrange_regions, flatten_regions
from ravenjax.ir.time_loop import TimeLoop, split_lanes
from ravenjax.numbers.vec import if_rarely

TICKS = 40


def series(x, terms):
    total = x
    for k in range(1, terms):
        total = total * x + 1.0 / k
    return total


def step(limit, x, now):
    """Two rare choices, the second inside the first's branch as well, and something that is read
    on both sides.
    """
    warm = x * 0.9 + jnp.sin(now * 0.1) * limit
    both = warm * warm

    def high():
        inner = if_rarely(both > 0.9, lambda: series(both, 30), both)
        return series(warm + both, 25) + inner, jnp.int32(3)

    value, code = if_rarely(warm > 0.8, high, (warm, jnp.int32(0)))
    low = if_rarely(value < -0.8, lambda: series(value, 22) * 0.01, value)
    return low * 0.5 + both * 0.01, code


def lowered():
    number, whole = jnp.float32(0), jnp.int32(0)
    programs = (
        jax.make_jaxpr(lambda limit: (limit * 0.0, whole))(number),
        jax.make_jaxpr(lambda limit, x, c, now: (lambda y, k: (y, c + k, y))(*step(limit, x, now)))(
            number, number, whole, whole
        ),
        jax.make_jaxpr(lambda limit, x, c: (x, c))(number, number, whole),
    )
    return TimeLoop(*(contract_to_fma(lowering.lower_jaxpr(jaxpr)) for jaxpr in programs))


@pytest.mark.parametrize("width", [1, 4, 16])
def test_passing_by_changes_no_bit(width):
    loop, lanes = lowered(), 32
    rng = np.random.default_rng(2)
    limit = rng.uniform(0.0, 1.0, lanes).astype(np.float32)
    limit[:20] *= 0.1  # whole vectors that are never there
    given, out = np.zeros((1, 0, lanes), np.float32), np.zeros((TICKS, 1, lanes), np.float32)
    kernel = print_kernel(split_lanes(loop, 0, False), width, jit.host_target().features)
    found = VectorCode(kernel).run_course(
        Lanes([limit], given, np.zeros(0, np.float32), out),
        LaneCourse(np.zeros(lanes // width, int), np.full(lanes, TICKS)),
    )
    state = semantics.run_program(loop.begin, [limit])
    for now in range(TICKS):
        *state, leaving = semantics.run_program(loop.step, [limit, *state, np.int32(now)])
        same_bits(out[now, 0], leaving)
    for got, right in zip(found, semantics.run_program(loop.finish, [limit, *state]), strict=True):
        same_bits(got, np.broadcast_to(right, got.shape))
    assert 0 < (found[1] > 0).sum() < lanes, "some lanes were there, some never"


@given(
    st.lists(
        st.tuples(st.sampled_from("fsr"), *[st.integers(0, 10**6)] * 3), min_size=1, max_size=60
    ),
    st.data(),
)
def test_any_program_can_be_arranged(choices, data):
    """f: a sum, s: a condition, r: a rare choice; of any earlier results."""
    builder = Builder()
    numbers, truths = [builder.input("float32") for _ in range(3)], [builder.input("bool")]
    for kind, a, b, c in choices:
        x, y, p = numbers[a % len(numbers)], numbers[b % len(numbers)], truths[c % len(truths)]
        if kind == "f":
            numbers.append(builder.emit("add", "float32", x, y))
        elif kind == "s":
            truths.append(builder.emit("lt", "bool", x, y))
        else:
            numbers.append(builder.emit("rarely", "float32", p, x, y))
    program = builder.program(data.draw(st.lists(st.sampled_from(numbers), min_size=1, max_size=4)))
    order = [i for i in program.needed() if program.operations[i].name != "input"]
    with mock.patch.object(regions, "MIN_OPERATIONS", 1):
        found = arrange_regions(program.operations, order, program.outputs)
    every = list(flatten_regions(found))
    assert sorted(every) == order
    place = {i: k for k, i in enumerate(every)}
    for item in found:
        if isinstance(item, Region):
            inside = set(item.operations)
            readers = [
                i for i in every if i not in inside and inside & set(program.operations[i].operands)
            ]
            assert all(program.operations[i].operands[0] == item.condition for i in readers)
            assert not inside & set(program.outputs)
    assert all(place.get(o, -1) < place[i] for i in every for o in program.operations[i].operands)
