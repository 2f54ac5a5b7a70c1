"""The ITP datagram has the layout of the original structure."""

from ravenjax.robots.raven2.console import packet


def test_layout_is_that_of_the_original():
    names = "sequence pactyp version delx dely delz Qx Qy Qz Qw buttonstate grasp surgeon_mode"
    assert packet.U_STRUCT.names == (*names.split(), "checksum")
    offsets = [packet.U_STRUCT.fields[name][1] for name in packet.U_STRUCT.names]
    assert offsets == [0, 4, 8, 12, 20, 28, 36, 52, 68, 84, 100, 108, 116, 120]
    assert packet.U_STRUCT.itemsize == 124
    assert packet.V_STRUCT.size == 52
