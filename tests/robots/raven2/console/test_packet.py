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
    offsets = {name: packet.U_STRUCT.fields[name][1] for name in packet.U_STRUCT.names}
    assert offsets == {
        "sequence": 0,
        "pactyp": 4,
        "version": 8,
        "delx": 12,
        "dely": 20,
        "delz": 28,
        "Qx": 36,
        "Qy": 52,
        "Qz": 68,
        "Qw": 84,
        "buttonstate": 100,
        "grasp": 108,
        "surgeon_mode": 116,
        "checksum": 120,
    }
    assert packet.U_STRUCT.itemsize == 124
    assert packet.V_STRUCT.itemsize == 52


@pytest.mark.parametrize("arms", [("gold",), ("green",), ("gold", "green")])
def test_there_and_back(arms):
    assert packet.decode(packet.encode(example(len(arms)), arms), arms) == example(len(arms))
