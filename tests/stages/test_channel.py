"""The network channel against the published emulator, run packet by packet with numpy's random
numbers.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.stages import channel

LANES, PACKETS = 400, 3000


def stepped(seeds, packets, fresh=True):
    """Quality and burst of each packet, arrays [packets, lanes]."""

    def one(state, k):
        state = channel.step(state, seeds, k, jnp.bool_(fresh))
        return state, state

    begin = jax.tree.map(lambda x: jnp.broadcast_to(x, jnp.shape(seeds)), channel.init())
    _, states = jax.jit(lambda: jax.lax.scan(one, begin, jnp.arange(packets, dtype=jnp.int32)))()
    return np.asarray(states.quality), np.asarray(states.burst)


@pytest.fixture(scope="module")
def run():
    return stepped(jnp.linspace(-1.0, 1.0, LANES), PACKETS)


def test_each_transition_is_as_likely_as_published(run):
    before, after = run[0][:-1].ravel(), run[0][1:].ravel()
    for quality, row in enumerate(channel.TRANSITIONS):
        next_ones = after[before == quality]
        found = np.bincount(next_ones, minlength=4) / len(next_ones)
        np.testing.assert_allclose(found, row, atol=5.0 * np.sqrt(0.25 / len(next_ones)))


def test_lengths_of_bursts_have_the_published_tail(run):
    """Packets lost in a row to one burst: 1 + floor(L), so P(at least k) = (2 / (k - 1)) ** 1.5
    from k = 3 on.
    """
    burst = run[1]
    ended = (burst[:-1] > 0) & (burst[1:] <= 1)
    lengths = burst[:-1][ended]
    assert lengths.min() == 3
    for k in (4, 6, 11, 21):
        expected = (2.0 / (k - 1)) ** 1.5
        assert (
            abs((lengths >= k).mean() - expected) < 4.0 * np.sqrt(expected / len(lengths)) + 0.005
        )


@pytest.mark.slow
def test_delays_are_the_sum_of_two_uniform_ones():
    drawn = np.asarray(
        jax.vmap(lambda k: channel.delay_ms(jnp.float32(0.3), k))(jnp.arange(40_000))
    )
    assert drawn.min() >= 11 and drawn.max() <= 110
    assert drawn.mean() == pytest.approx(60.5, abs=0.6)
    assert drawn.std() == pytest.approx(np.sqrt((90.0**2 + 9.0**2) / 12.0), rel=0.02)
    assert int(channel.delay_ms(jnp.float32(0.0), jnp.int32(5))) == 0
