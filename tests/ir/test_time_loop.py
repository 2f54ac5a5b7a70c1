"""A time loop split by what its numbers depend on, and run as vector code, against the same loop
in NumPy.
"""

from __future__ import annotations

import numpy as np
import pytest
from compiled_program import same_bits
from small_loop import TABLE, in_numpy, loop

from ravenjax.engines.cpu import kernel
from ravenjax.engines.cpu.code import VectorCode
from ravenjax.engines.lanes import Lanes
from ravenjax.ir.time_loop import split

TICKS = 1003  # not a multiple of the chunk


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
    expected, expected_out = in_numpy(found, gain, kick, given[:, 0], TICKS)
    assert sum(done) == TICKS * lanes
    same_bits(out, expected_out)
    for got, right in zip(results, expected, strict=True):
        same_bits(got, np.broadcast_to(right, got.shape).astype(got.dtype))


@pytest.mark.parametrize("window", [1, 3, 200])
def test_a_schedule_is_an_order_that_can_be_run(window):
    program = loop().step
    order = program.needed()
    arranged = kernel.schedule(program.operations, order, window)
    assert sorted(arranged) == order
    place = {i: k for k, i in enumerate(arranged)}
    assert all(place[o] < place[i] for i in order for o in program.operations[i].operands)
