"""The packet clock: lengths come as often as stated, and packets at the ticks that the lengths
say.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.stages import packet_clock
from ravenjax.vocabulary import packets

DISTRIBUTIONS = (*packets.SHARES, (0.0, 0.25, 0.0, 0.75))
DRAWS = 200_000


def lengths(choice, key: int, count: int = DRAWS) -> np.ndarray:
    one = partial(packet_clock.packet_length, DISTRIBUTIONS, choice, jnp.uint32(key))
    return np.asarray(jax.jit(jax.vmap(one))(jnp.arange(count, dtype=jnp.int32)))


@pytest.mark.parametrize("choice", range(len(DISTRIBUTIONS)))
def test_lengths_are_as_frequent_as_stated(choice):
    shares = np.array(DISTRIBUTIONS[choice])
    counts = np.bincount(lengths(np.int32(choice), 7), minlength=len(shares) + 1)[1:]
    assert len(counts) == len(shares)
    spread = np.sqrt(DRAWS * shares * (1.0 - shares))
    assert (np.abs(counts - DRAWS * shares) <= 4.5 * spread).all()


@pytest.mark.slow
def test_packets_come_where_the_lengths_say():
    clock, index, ticks = packet_clock.init(), -1, []
    for now in range(400):
        fresh = now >= int(clock.due)
        index += fresh
        cycles = packet_clock.packet_length(
            DISTRIBUTIONS, np.int32(packets.BURSTS), jnp.uint32(5), jnp.int32(index)
        )
        before = clock.tick
        clock = packet_clock.step(clock, jnp.int32(now), jnp.bool_(fresh), cycles)
        if fresh:
            ticks.append(now)
            assert int(clock.before) == int(before) and int(clock.tick) == now
    assert ticks[0] == 0
    np.testing.assert_array_equal(
        np.diff(ticks), lengths(np.int32(packets.BURSTS), 5, len(ticks) - 1)
    )
