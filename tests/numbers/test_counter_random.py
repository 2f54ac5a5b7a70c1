"""Counter-based random numbers: distribution, independence, determinism."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from ravenjax.numbers import counter_random

TICKS = jnp.arange(200_000, dtype=jnp.int32)


def draw(function, key: int, channel: int) -> np.ndarray:
    return np.asarray(
        jax.jit(jax.vmap(lambda tick: function(jnp.uint32(key), tick, channel)))(TICKS), np.float64
    )


@pytest.mark.parametrize(("key", "channel"), [(0, 0), (1, 0), (0, 1), (0xDEADBEEF, 7)])
def test_uniform_and_normal_have_their_distribution(key: int, channel: int) -> None:
    uniform, normal = (
        draw(counter_random.random_uniform, key, channel),
        draw(counter_random.random_normal, key, channel),
    )
    assert uniform.min() >= 0.0 and uniform.max() < 1.0
    assert stats.kstest(uniform, "uniform").pvalue > 1e-3
    assert stats.kstest(normal, "norm").pvalue > 1e-3
    assert np.isfinite(normal).all() and np.abs(normal).max() < 5.0


def test_ticks_channels_and_keys_are_independent() -> None:
    base = draw(counter_random.random_normal, 5, 3)
    others = [
        base[1:],  # the next tick
        base[7:],
        draw(counter_random.random_normal, 5, 4),
        draw(counter_random.random_normal, 6, 3),
        draw(counter_random.random_normal, 5 ^ 0x80000000, 3),
    ]
    for other in others:
        size = len(other)
        correlation = np.corrcoef(base[:size], other)[0, 1]
        of_squares = np.corrcoef(base[:size] ** 2, other**2)[0, 1]
        assert abs(correlation) < 4.5 / np.sqrt(size) and abs(of_squares) < 4.5 / np.sqrt(size)


def test_the_stream_is_pinned() -> None:
    """Stored campaigns are replayed from (key, tick, channel): changing the stream breaks every
    stored run.
    """

    def mix(x: int) -> int:
        x = ((x ^ (x >> 16)) * 0x7FEB352D) & 0xFFFFFFFF
        x = ((x ^ (x >> 15)) * 0x846CA68B) & 0xFFFFFFFF
        return x ^ (x >> 16)

    for key, tick, channel in [(0, 0, 0), (123, 456, 7), (2**32 - 1, 2**31 - 1, 13)]:
        counter = (tick * 0x9E3779B9 + channel * 0x85EBCA6B) & 0xFFFFFFFF
        expected = mix(mix(counter) ^ mix(key))
        assert (
            int(counter_random.random_bits(jnp.uint32(key), jnp.int32(tick), channel)) == expected
        )
