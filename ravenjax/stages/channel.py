"""Models a network channel that loses packets in bursts and delivers packets late.

The seed selects the random draws; without a seed the channel is ideal. The model is the emulator of
UVA-DSA's Activity-Aware-Recovery (network/interception.py, config.json), packet by packet:

- The quality of the channel changes between good, bad and two intermediate states by TRANSITIONS.
  It begins good.
- A packet outside a burst begins a burst with the probability LOSS of the present quality. A burst
  loses that packet and floor(L) more, where L has a Pareto distribution, alpha 1.5, scale 2. So at
  least three packets are lost. After k >= 3 lost packets, the burst continues with the probability
  P(L >= k | L >= k - 1) = ((k - 1) / k) ** 1.5. The model draws this instead of L.
- A packet is late by a delay of 10 to 100 ms and a jitter of 1 to 10 ms, both uniform.

Simplification: at most one packet arrives in a tick. Each tick draws a delay d. The newest packet
that was sent at least d ago arrives, unless a newer packet has arrived before. Packets that others
overtook are therefore lost, as the robot's check of sequence numbers would drop them. The
emulator's loss of the whole connection is the fault effect `drop`.
"""

from ravenjax import resources
from ravenjax.numbers import Scalar, as_int, jnp, lax, record, where
from ravenjax.numbers.counter_random import random_uniform
from ravenjax.numbers.vec import number_at

_TABLES = resources.read_tables(__file__, "channel.toml")
TRANSITIONS: list[list[float]] = _TABLES["transitions"]
"""Probabilities from a quality (row) to the next: good, bad, intermediate 1 and 2."""
LOSS: list[float] = _TABLES["loss"]
"""Probability that a packet begins a burst, by quality."""
MIN_FURTHER_PACKETS = 2
"""Smallest number of packets in a burst after its first: the Pareto distribution's scale."""
DELAY_MS, JITTER_MS = (10.0, 100.0), (1.0, 10.0)

_QUALITY, _CONTINUES, _BEGINS, _DELAY, _JITTER = range(5)
"""Indices of the random numbers that are drawn for each packet."""


@record
class ChannelState:
    """The channel's state from packet to packet."""

    quality: Scalar  # int32, row of TRANSITIONS
    burst: Scalar  # int32, packets in a row lost to the present burst; 0: no burst


def init() -> ChannelState:
    """Return the state of a good channel without a burst."""
    return ChannelState(jnp.int32(0), jnp.int32(0))


def step(state: ChannelState, seed: Scalar, packet: Scalar, fresh: Scalar) -> ChannelState:
    """Return the state of the channel after a control cycle.

    packet: index of the newest packet, int32. fresh: whether this packet was sent in the cycle,
    bool. seed: selects the random numbers, float; 0: an ideal channel, which resets its state.
    """
    key = _random_key(seed)
    quality = _next_quality(state.quality, random_uniform(key, packet, _QUALITY))

    def raised_to_minimum(packets: Scalar) -> Scalar:
        # A burst of up to MIN_FURTHER_PACKETS packets continues for certain: the quotient is 1.
        return lax.convert_element_type(jnp.maximum(packets, MIN_FURTHER_PACKETS), jnp.float32)

    # A burst continues after its k-th lost packet with the probability q^1.5, q = (k - 1) / k.
    quotient = raised_to_minimum(state.burst - 1) / raised_to_minimum(state.burst)
    continues = (state.burst > 0) & (
        random_uniform(key, packet, _CONTINUES) < quotient * jnp.sqrt(quotient)
    )
    begins = random_uniform(key, packet, _BEGINS) < number_at(quality, LOSS)
    burst = jnp.where(continues, state.burst + 1, as_int(begins))
    after = where(fresh, ChannelState(quality, burst), state)
    return where(seed != 0.0, after, init())


def delay_ms(seed: Scalar, packet: Scalar) -> Scalar:
    """Return the channel's delay (ms, int32) while the packet with index `packet` is the newest.
    It is drawn anew for each packet. The delay of an ideal channel, seed 0, is 0.
    """
    # `as_int` removes the decimals, so 0.5 is added to round to the nearest millisecond.
    delay = jnp.float32(0.5)
    for draw, (lowest, highest) in ((_DELAY, DELAY_MS), (_JITTER, JITTER_MS)):
        delay = (
            delay + lowest + (highest - lowest) * random_uniform(_random_key(seed), packet, draw)
        )
    return jnp.where(seed != 0.0, as_int(delay), 0)


def _random_key(seed: Scalar) -> Scalar:
    return lax.bitcast_convert_type(lax.convert_element_type(seed, jnp.float32), jnp.uint32)


def _next_quality(quality: Scalar, drawn: Scalar) -> Scalar:
    """Return the next quality, int32. drawn: uniform random number in [0, 1)."""
    next_quality = jnp.int32(0)
    # The quality is at least k if `drawn` is not below the sum of the first k probabilities.
    for k in (1, 2, 3):
        sums = [sum(row[:k]) for row in TRANSITIONS]
        next_quality = next_quality + as_int(drawn >= number_at(quality, sums))
    return next_quality
