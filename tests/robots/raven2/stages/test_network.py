"""Size and sequence rules against the table of the original, one packet at a time."""

import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import network

SETUP = RavenSetup()
HIGHEST = 2**32 - 1


def packet(sequence, size=124, received=1):
    number = np.int32(np.uint32(sequence).view(np.int32))
    zero = Vec.full(3, np.int32(0))
    unit = Vec((0.0, 0.0, 0.0, 1.0))
    return Packet(
        np.int32(received), np.int32(size), number, (zero,), (unit,), (np.int32(0),), np.int32(1)
    )


def offer(last, sequence, **more):
    """Accepted?, the new last number, and which check tripped."""
    state = replace(network.init(SETUP), last=jnp.int32(np.uint32(last).view(np.int32)))
    state, accepted = network.step(SETUP, state, np.int32(7), packet(sequence, **more))
    names = ("size", "zero", "skip", "duplicate", "reset", "out_of_sequence")
    tripped = [name for name in names if int(getattr(state, name).count)]
    assert all(
        int(getattr(state, name).first_tick) == (7 if name in tripped else -1) for name in names
    )
    return bool(accepted), int(state.last) % 2**32, tripped


@pytest.mark.parametrize(
    ("last", "sequence", "expected"),
    [
        (0, 1, (True, 1, [])),
        (41, 42, (True, 42, [])),
        (41, 0, (False, 41, ["zero"])),
        (41, 43, (False, 43, ["skip"])),
        (41, 41, (False, 41, ["duplicate"])),
        (41, 40, (False, 41, ["out_of_sequence"])),
        (1001, 1, (False, 1001, ["out_of_sequence"])),
        (1002, 1, (False, 1, ["reset"])),
        (5000, 3999, (False, 3999, ["reset"])),
        (5000, 4000, (False, 5000, ["out_of_sequence"])),
        (2**31 - 1, 2**31, (True, 2**31, [])),
        (2**31 + 5, 7, (False, 7, ["reset"])),
        (7, HIGHEST, (False, HIGHEST, ["skip"])),
    ],
)
def test_sequence_rules(last, sequence, expected):
    assert offer(last, sequence) == expected


def test_only_shorter_datagrams_are_dropped():
    assert offer(0, 1, size=123) == (False, 0, ["size"])
    assert offer(0, 1, size=4000) == (True, 1, [])
    assert offer(0, 1, received=0) == (False, 0, [])
