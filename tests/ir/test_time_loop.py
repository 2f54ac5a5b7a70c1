"""A time loop split by what its numbers depend on, and run as vector code, against the same loop
in NumPy.
"""

import numpy as np
import pytest
from compiled_program import same_bits
from small_loop import TABLE, in_numpy, loop

from ravenjax.engines.cpu import jit, kernel
from ravenjax.engines.cpu.code import LaneCourse, VectorCode
from ravenjax.engines.lanes import Lanes
from ravenjax.ir.time_loop import split_lanes

TICKS = 1003  # not a multiple of the chunk


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
    features = jit.host_target().features
    code = VectorCode(kernel.print_kernel(split_lanes(found, 1, grouped), width, features))
    course = LaneCourse(np.zeros(lanes // width, int), np.full(lanes, TICKS))
    results = code.run_course(Lanes([gain, kick], given, TABLE, out), course, done.append)
    expected, expected_out = in_numpy(found, gain, kick, given[:, 0], TICKS)
    assert sum(done) == TICKS * lanes
    same_bits(out, expected_out)
    for got, right in zip(results, expected, strict=True):
        same_bits(got, np.broadcast_to(right, got.shape).astype(got.dtype))


@pytest.mark.parametrize("window", [1, 3, 200])
def test_a_schedule_is_an_order_that_can_be_run(window, monkeypatch):
    monkeypatch.setattr(kernel, "WINDOW", window)
    program = loop().step
    order = program.needed()
    arranged = kernel.schedule_operations(program.operations, order)
    assert sorted(arranged) == order
    place = {i: k for k, i in enumerate(arranged)}
    assert all(place[o] < place[i] for i in order for o in program.operations[i].operands)
