"""The ITP datagram: layout of the original structure, encoding there and back, checksum."""

import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console import packet
from ravenjax.robots.raven2.console.packet import Packet


def example(arms: int = 2, sequence: int = 7) -> Packet:
    return Packet(
        received=1,
        size=124,
        sequence=sequence,
        delta=(Vec((1, -2, 3)), Vec((-40, 50, -60)))[:arms],
        quat=(Vec((0.0, 0.0, 0.6, 0.8)), Vec((0.5, 0.5, 0.5, 0.5)))[:arms],
        grasp=(9, -8)[:arms],
        surgeon_mode=1,
    )


def test_layout_is_that_of_the_original():
    names = "sequence pactyp version delx dely delz Qx Qy Qz Qw buttonstate grasp surgeon_mode"
    assert packet.U_STRUCT.names == (*names.split(), "checksum")
    offsets = [packet.U_STRUCT.fields[name][1] for name in packet.U_STRUCT.names]
    assert offsets == [0, 4, 8, 12, 20, 28, 36, 52, 68, 84, 100, 108, 116, 120]
    assert packet.U_STRUCT.itemsize == 124
    assert packet.V_STRUCT.itemsize == 52


@pytest.mark.parametrize("arms", [("gold",), ("green",), ("gold", "green")])
def test_there_and_back(arms):
    assert packet.decode(packet.encode(example(len(arms)), arms), arms) == example(len(arms))
