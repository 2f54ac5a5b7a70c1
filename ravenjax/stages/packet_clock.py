"""Computes in which control cycles the console's packets reach the robot.

The length of a packet is the number of control cycles until the next packet. It is drawn at random
when the packet arrives. The original's network thread adds the increments of every datagram to the
desired position. The control cycle reads the sum or, with a console that sends positions, the last
position (raven2: network_layer.cpp, local_io.cpp). Datagrams that arrive in one cycle therefore act
as one packet, and this module computes them as one packet. A burst of datagrams is a single packet
with all the motion since the packet before. A gap without datagrams makes one packet long.

Simplification: lengths are independent. In recordings they are correlated.
"""

from collections.abc import Sequence

import numpy as np

from ravenjax.numbers import Scalar, as_int, jnp, record, where
from ravenjax.numbers.counter_random import random_uniform
from ravenjax.numbers.vec import number_at

_LENGTH = 0
"""Index of the random number for the length, among those that are drawn for a packet."""


@record
class PacketClock:
    """Times of the newest packet, of the packet before it, and of the next one."""

    due: Scalar  # int32, tick of the next packet
    tick: Scalar  # int32, tick of the newest packet; -1: none yet
    before: Scalar  # int32, tick of the packet before that one; -1: none


def init() -> PacketClock:
    """Return the clock before the first packet, which comes in tick 0."""
    return PacketClock(jnp.int32(0), jnp.int32(-1), jnp.int32(-1))


def step(clock: PacketClock, now: Scalar, fresh: Scalar, cycles: Scalar) -> PacketClock:
    """Return the clock after tick `now` (int32).

    fresh: whether a packet arrived in this tick, bool. cycles: cycles until the next, int32.
    """
    return where(fresh, PacketClock(now + cycles, now, clock.tick), clock)


def packet_length(
    distributions: Sequence[Sequence[float]], choice: Scalar, key: Scalar, packet: Scalar
) -> Scalar:
    """Return the number of cycles (int32) that the packet with index `packet` (int32) lasts.

    distributions: shares of packets that last 1, 2, 3, .. cycles; choice: index of one
    distribution; key: uint32, random key of the run.
    """
    # For each distribution: the share of packets that last at most 1, 2, 3, .. cycles.
    cumulative = [np.cumsum(shares[:-1]) for shares in distributions]
    # If all runs have the same distribution, the compiled tick contains only this one.
    if isinstance(choice, np.integer):
        cumulative, choice = [cumulative[choice]], np.int32(0)
    drawn = random_uniform(key, packet, _LENGTH)
    cycles = jnp.int32(1)
    for k in range(max(len(shares) for shares in cumulative)):
        # `drawn` is below 1, so a bound of 1 adds no cycle.
        bounds = [float(shares[k]) if k < len(shares) else 1.0 for shares in cumulative]
        cycles = cycles + as_int(drawn >= number_at(choice, bounds))
    return cycles
