"""Computes in which control cycles the console's packets reach the robot.

The length of a packet is the number of control cycles until the next packet. It is drawn at random
when the packet arrives. Lengths are drawn independently; in recordings they are correlated.

On the real robot, several datagrams of the console may arrive in one control cycle. The network
thread adds up their increments, and the control cycle reads only the sum. If the console sends
positions, the control cycle reads only the last position (raven2: network_layer.cpp, local_io.cpp).
Datagrams of one cycle therefore act as one packet, and this module computes them as one packet with
all the motion since the packet before. While no datagrams arrive, the last packet becomes longer.
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
    """Return the clock after tick `now` (int32). fresh: whether a packet arrived in this tick,
    bool. cycles: cycles until the next packet, int32.
    """
    return where(fresh, PacketClock(now + cycles, now, clock.tick), clock)


def packet_length(
    distributions: Sequence[Sequence[float]], choice: Scalar, key: Scalar, packet: Scalar
) -> Scalar:
    """Return the number of cycles (int32) that the packet with index `packet` (int32) lasts.
    It is drawn at random. distributions: each has the shares of packets that last 1, 2, 3, ..
    cycles. choice: index of the run's distribution, int32. key: random key of the run, uint32.
    """
    # For each distribution: the shares of packets that last at most 1, 2, 3, .. cycles. The largest
    # share, 1, is left out.
    cumulative = [np.cumsum(shares[:-1]) for shares in distributions]
    # A NumPy number is the same in all runs. The compiled tick then contains one distribution.
    if isinstance(choice, np.integer):
        cumulative, choice = [cumulative[choice]], np.int32(0)
    # A packet lasts one cycle, plus one for each cumulative share that `drawn` reaches.
    drawn = random_uniform(key, packet, _LENGTH)
    cycles = jnp.int32(1)
    for k in range(max(len(sums) for sums in cumulative)):
        # Shorter distributions get the share 1, which `drawn` never reaches.
        kth_shares = [float(sums[k]) if k < len(sums) else 1.0 for sums in cumulative]
        cycles = cycles + as_int(drawn >= number_at(choice, kth_shares))
    return cycles
