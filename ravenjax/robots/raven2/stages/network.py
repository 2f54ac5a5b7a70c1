"""Decides which datagrams the robot accepts, by size and sequence number.

Source: raven2 network_layer.cpp. The sequence number is unsigned in the datagram. In this module it
is an int32 whose bits are compared as unsigned. The datagram contains a checksum that is not
verified. A datagram longer than the structure is cut and accepted; a shorter one is dropped.
"""

import numpy as np

from ravenjax.numbers import INT32_MIN, Scalar, cast_to_real, jnp, record
from ravenjax.robots.raven2.console.packet import SIZE_BYTES, Packet
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import check
from ravenjax.stages.check import CheckHistory

RESET_GAP = 1000
"""A sequence number that is lower by more than this number restarts the stream of packets."""


@record
class NetworkState:
    last: Scalar  # int32, sequence number that the next packet must follow
    size: CheckHistory  # margin: bytes above the size of the structure
    zero: CheckHistory  # trips on sequence number 0, which is reserved
    skip: CheckHistory  # trips on a gap: this packet is lost as well
    duplicate: CheckHistory
    reset: CheckHistory  # far behind: the stream is considered restarted; this packet is lost
    out_of_sequence: CheckHistory  # behind, but not far


def init(setup: RavenSetup) -> NetworkState:
    """Return the state before any packet: the first accepted packet is number 1."""
    return NetworkState(np.int32(0), *(check.init(setup),) * 6)


def _below(a: Scalar, b: Scalar) -> Scalar:
    """Return a < b for unsigned numbers in int32. Flipping the top bit gives int32 their order."""
    return (a ^ INT32_MIN) < (b ^ INT32_MIN)


def step(
    setup: RavenSetup, state: NetworkState, tick: Scalar, packet: Packet
) -> tuple[NetworkState, Scalar]:
    """Return the state after a packet, and whether the packet is accepted: complete and in order.
    Other packets are dropped, but a greater or a much lower number becomes the last number.
    """
    received = packet.received != 0
    extra_bytes = packet.size - SIZE_BYTES[setup.console]
    too_short = received & (extra_bytes < 0)
    number, last = packet.sequence, state.last
    complete = received & (extra_bytes >= 0)
    # Number 0 is reserved.
    zero = complete & (number == 0)
    numbered = complete & (number != 0)
    accepted = numbered & (number == last + 1)
    skip = numbered & _below(last + 1, number)
    duplicate = numbered & (number == last)
    # After 0xFFFFFFFF, number 1 is above last + 1 = 0, a skip, and also far below `last`, a reset.
    # Both make 1 the last number, so 2 is then accepted.
    behind = numbered & _below(number, last) & ~accepted
    far_behind = _below(RESET_GAP, last) & _below(number, last - RESET_GAP)
    reset = behind & far_behind
    new_last = jnp.where(accepted | skip | reset, number, last)
    margin = jnp.where(received, cast_to_real(setup, extra_bytes), np.inf)
    state = NetworkState(
        new_last,
        check.update_check(state.size, tick, too_short, margin),
        check.update_check(state.zero, tick, zero),
        check.update_check(state.skip, tick, skip),
        check.update_check(state.duplicate, tick, duplicate),
        check.update_check(state.reset, tick, reset),
        check.update_check(state.out_of_sequence, tick, behind & ~far_behind),
    )
    return state, accepted
