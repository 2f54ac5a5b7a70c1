"""The packet clock: lengths come as often as stated, and packets at the ticks that the lengths
say.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_program import compiled, lowered, same_bits

from ravenjax.stages import packet_clock
from ravenjax.vocabulary import packets

DISTRIBUTIONS = (*packets.SHARES, (0.0, 0.25, 0.0, 0.75))
DRAWS = 200_000


def lengths(choice, key: int, count: int = DRAWS) -> np.ndarray:
    one = partial(packet_clock.length, DISTRIBUTIONS, choice, jnp.uint32(key))
    return np.asarray(jax.jit(jax.vmap(one))(jnp.arange(count, dtype=jnp.int32)))


@pytest.mark.parametrize("choice", range(len(DISTRIBUTIONS)))
def test_lengths_are_as_frequent_as_stated(choice):
    shares = np.array(DISTRIBUTIONS[choice])
    counts = np.bincount(lengths(np.int32(choice), 7), minlength=len(shares) + 1)[1:]
    assert len(counts) == len(shares)
    spread = np.sqrt(DRAWS * shares * (1.0 - shares))
    assert (np.abs(counts - DRAWS * shares) <= 4.5 * spread).all()


@pytest.mark.parametrize("shares", packets.SHARES)
def test_shares_with_a_name_sum_to_one(shares):
    assert sum(shares) == pytest.approx(1.0, abs=1e-9) and min(shares) >= 0.0


def test_a_choice_that_varies_draws_the_same():
    for choice in range(len(DISTRIBUTIONS)):
        np.testing.assert_array_equal(
            lengths(np.int32(choice), 3, 999), lengths(jnp.int32(choice), 3, 999)
        )


def test_runs_with_another_key_draw_others():
    assert (
        lengths(np.int32(packets.BURSTS), 3, 99) == lengths(np.int32(packets.BURSTS), 3, 99)
    ).all()
    assert (
        lengths(np.int32(packets.BURSTS), 3, 99) != lengths(np.int32(packets.BURSTS), 4, 99)
    ).any()


def ticking(choice, key, now, due, tick, before, packet):
    """One tick of the clock as plain numbers."""
    clock = packet_clock.PacketClock(due, tick, before)
    cycles = packet_clock.length(DISTRIBUTIONS, choice, key, packet)
    return jax.tree.leaves(packet_clock.step(clock, now, now >= due, cycles))


def test_packets_come_where_the_lengths_say():
    clock, index, ticks = packet_clock.init(), -1, []
    for now in range(400):
        fresh = now >= int(clock.due)
        index += fresh
        cycles = packet_clock.length(
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


def test_compiled_code_has_the_bits_of_xla():
    rng = np.random.default_rng(4)
    size = 4000
    columns = (
        rng.integers(0, len(DISTRIBUTIONS), size).astype(np.int32),
        rng.integers(0, 2**32, size, dtype=np.uint32),
        *(rng.integers(-2, 3000, size).astype(np.int32) for _ in range(5)),
    )
    expected = jax.jit(jax.vmap(ticking))(*columns)
    for got, right in zip(compiled(lowered(ticking, *columns), 16, columns), expected, strict=True):
        same_bits(got, np.asarray(right))
