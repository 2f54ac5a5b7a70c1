"""The watch over cables, against NumPy over whole runs: largest share, first overload and whose
it was.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Vec
from ravenjax.stages import overload

ARMS, CABLES, TICKS = 2, 3, 12
# XLA takes subnormal numbers as zero.
SHARES = st.floats(0.0, 2.0, width=32, allow_subnormal=False)


@partial(jax.jit)
def watched(loads):
    """After rows of loads [ticks, arms, cables]."""

    def one(state, row):
        tick, load = row
        arms = tuple(Vec(load[arm, cable] for cable in range(CABLES)) for arm in range(ARMS))
        return overload.step(state, arms, tick), None

    ticks = jnp.arange(len(loads), dtype=jnp.int32)
    state, _ = jax.lax.scan(one, overload.init(Setup()), (ticks, loads))
    return overload.outcomes(Setup(), state)


@settings(deadline=None, max_examples=60)
@given(st.lists(SHARES, min_size=ARMS * CABLES * TICKS, max_size=ARMS * CABLES * TICKS))
def test_it_is_what_the_whole_course_says(shares):
    loads = np.array(shares, np.float32).reshape(TICKS, ARMS, CABLES)
    out = {name: np.asarray(value) for name, value in watched(loads).items()}
    assert out["cable_load"] == loads.max()
    over = (loads > 1.0).any(axis=(1, 2))
    first = int(np.argmax(over)) if over.any() else -1
    assert out["cable_overload_first_ms"] == first
    assert out["cable_overload"] == (np.argmax(loads[first]) if first >= 0 else -1)
