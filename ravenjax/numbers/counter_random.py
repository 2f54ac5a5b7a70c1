"""Generates random numbers by counter: one (key, tick, channel) gives one number on all engines.

A run's noise therefore does not depend on the order in which runs are computed. A run and its
golden run have the same key, so they have the same random numbers. Only 32-bit integer
multiplications, xors and shifts are used, so the numbers have the same bits on every machine.

The function `lowbias32` (C. Wellons, "Prospecting for hash functions", 2018; exact bias 0.174) is
applied to the key, then to the counter.
"""

import math

from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.vec import Scalar

GOLDEN = 0x9E3779B9  # 2^32 / golden ratio, so that counters of consecutive ticks differ much
CHANNEL_STRIDE = 0x85EBCA6B  # an odd number, so that channels have different counters


def _mix(x: Scalar) -> Scalar:
    x = (x ^ (x >> jnp.uint32(16))) * jnp.uint32(0x7FEB352D)
    x = (x ^ (x >> jnp.uint32(15))) * jnp.uint32(0x846CA68B)
    return x ^ (x >> jnp.uint32(16))


def random_bits(key: Scalar, tick: Scalar, channel: int) -> Scalar:
    """Return 32 random bits (uint32) for a run's `key` (uint32), `tick` (int32) and `channel`, the
    number of a random signal.
    """
    # The mask makes the Python number a 32-bit number, as the other operands are.
    channel_offset = jnp.uint32((channel * CHANNEL_STRIDE) & 0xFFFFFFFF)
    counter = lax.convert_element_type(tick, jnp.uint32) * jnp.uint32(GOLDEN) + channel_offset
    return _mix(_mix(counter) ^ _mix(lax.convert_element_type(key, jnp.uint32)))


def random_uniform(key: Scalar, tick: Scalar, channel: int) -> Scalar:
    """Return a uniform float32 in [0, 1): the upper 24 of the random bits, divided by 2^24."""
    upper = lax.convert_element_type(random_bits(key, tick, channel) >> jnp.uint32(8), jnp.float32)
    return upper * 2.0**-24


def random_normal(key: Scalar, tick: Scalar, channel: int) -> Scalar:
    """Return a standard normal float32 by the method of Box and Muller, at most 4.9 standard
    deviations from 0. The upper 16 random bits give the radius, the lower 16 bits the angle.
    """
    word = random_bits(key, tick, channel)
    upper = lax.convert_element_type(word >> jnp.uint32(16), jnp.float32)
    lower = lax.convert_element_type(word & jnp.uint32(0xFFFF), jnp.float32)
    # 0.5 is added, so that the logarithm is of a number above 0. The factor 2^-16 maps to 0..1.
    radius = jnp.sqrt(-2.0 * jnp.log((upper + 0.5) * 2.0**-16))
    return radius * jnp.cos((lower + 0.5) * (2.0 * math.pi * 2.0**-16))
