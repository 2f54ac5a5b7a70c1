"""A time loop split by what its numbers depend on, and run as vector code, against the same loop
in NumPy.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import same_bits

from ravenjax.engines.cpu import kernel
from ravenjax.engines.cpu.code import VectorCode
from ravenjax.engines.lanes import Lanes
from ravenjax.ir import lowering, semantics
from ravenjax.ir.builder import contract
from ravenjax.ir.time_loop import TimeLoop, split

F, I = jax.ShapeDtypeStruct((), jnp.float32), jax.ShapeDtypeStruct((), jnp.int32)
TABLE = np.linspace(-1.0, 2.0, 12).astype(np.float32)
TICKS = 1003  # not a multiple of the chunk


def begin(gain, kick):
    """State: clock, filtered table, position, never changing, swapped pair, flag, and what
    nothing reads.
    """
    return (
        jnp.int32(5),
        jnp.float32(0),
        kick * 0.5,
        kick + 1.0,
        jnp.float32(1),
        kick,
        jnp.bool_(False),
        jnp.float32(3),
    )


def step(gain, kick, state, now, given, table):
    clock, smooth, position, fixed, left, right, flag, unread = state
    drive = table.at[clock % 12].get(mode="clip", wrap_negative_indices=False) * gain
    smooth = smooth + 0.1 * (drive - smooth)
    position = (
        position
        + 0.01 * (jnp.sin(smooth) - position * fixed)
        + jnp.where(now == 7, kick, 0.0)
        + given * 1e-3
    )
    flag = flag | (position > 0.3)
    new = (clock + 1, smooth, position, fixed, right, left + 0.0, flag, unread + position)
    return new, (position, smooth)


def finish(gain, kick, state):
    return {
        "position": state[2],
        "clock": state[0],
        "flag": state[6],
        "left": state[4] * gain,
        "smooth": state[1],
    }


def loop() -> TimeLoop:
    table = jax.ShapeDtypeStruct(TABLE.shape, TABLE.dtype)
    traced = jax.make_jaxpr(begin, return_shape=True)(F, F)
    state = traced[1]
    closed = (
        traced[0],
        jax.make_jaxpr(step)(F, F, state, I, F, table),
        jax.make_jaxpr(finish)(F, F, state),
    )
    return TimeLoop(*(contract(lowering.lower(jaxpr)) for jaxpr in closed))


def in_numpy(found: TimeLoop, gain, kick, given):
    state = [np.broadcast_to(x, gain.shape) for x in semantics.run(found.begin, [gain, kick])]
    out = []
    for tick in range(TICKS):
        entering = [np.full(gain.shape, tick, np.int32), given[min(tick, len(given) - 1)]]
        results = semantics.run(found.step, [gain, kick, *state, *entering], [TABLE])
        state = results[: len(state)]
        out.append([np.broadcast_to(x, gain.shape) for x in results[len(state) :]])
    return semantics.run(found.finish, [gain, kick, *state]), np.array(out)


def test_each_number_is_computed_where_it_belongs():
    parts = split(loop(), shared_inputs=[0], shared_ticks=[0, 1])
    assert parts.shared_state == (0, 1)  # clock and filter: of the group
    assert parts.lane_state == (2, 4, 5, 6)
    assert parts.held_state == (3,)
    names = [parts.loop.step.operations[i].name for i in parts.lane]
    assert "lookup" not in names and "mul" not in names  # the sine came along as one number a tick
    assert 7 not in (*parts.lane_state, *parts.held_state, *parts.shared_state)


def test_inputs_of_its_own_make_a_lane_compute_more():
    alike, apart = (split(loop(), shared, ticks) for shared, ticks in (([0], [0, 1]), ([], [0])))
    assert len(apart.lane) > len(alike.lane)
    assert apart.shared_state == (0,)


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 4, 16])
@pytest.mark.parametrize("grouped", [True, False])
def test_vector_code_runs_the_loop(width, grouped):
    found, lanes = loop(), 16
    rng = np.random.default_rng(4)
    kick = rng.uniform(-0.5, 0.5, lanes).astype(np.float32)
    gain = (
        np.full(lanes, 1.3, np.float32)
        if grouped
        else rng.uniform(0.5, 2.0, lanes).astype(np.float32)
    )
    given = rng.uniform(-1, 1, (TICKS, 1) if grouped else (TICKS, 1, lanes)).astype(np.float32)
    out = np.zeros((TICKS, 2, lanes), np.float32)
    done = []
    code = VectorCode(found, 1, grouped, width)
    results = code.run(Lanes([gain, kick], given, TABLE, out), TICKS, done.append)
    expected, expected_out = in_numpy(found, gain, kick, given[:, 0])
    assert sum(done) == TICKS * lanes
    same_bits(out, expected_out)
    for got, right in zip(results, expected, strict=True):
        same_bits(got, np.broadcast_to(right, got.shape).astype(got.dtype))


def test_nobody_has_to_ask_for_what_goes_out():
    found, lanes = loop(), 32
    inputs = [np.ones(lanes, np.float32), np.linspace(0, 1, lanes).astype(np.float32)]
    given, out = np.zeros((1, 1), np.float32), np.zeros((TICKS, 2, lanes), np.float32)
    code = VectorCode(found, 1, True, 16)
    asked, silent = (code.run(Lanes(inputs, given, TABLE, where), TICKS) for where in (out, None))
    for a, b in zip(asked, silent, strict=True):
        same_bits(a, b)


@pytest.mark.parametrize("window", [1, 3, 200])
def test_a_schedule_is_an_order_that_can_be_run(window):
    program = loop().step
    order = program.needed()
    arranged = kernel.schedule(program.operations, order, window)
    assert sorted(arranged) == order
    place = {i: k for k, i in enumerate(arranged)}
    assert all(place[o] < place[i] for i in order for o in program.operations[i].operands)
