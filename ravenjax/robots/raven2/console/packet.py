"""The console's packet: one ITP datagram as a record of single numbers, and as bytes.

Layout, frames and units: raven2 `include/itp_teleoperation.h` (packed, little-endian, UDP port
36000). Index 0 of each pair is the gold arm, 1 the green arm.
"""

import functools
import struct
from typing import Any

import numpy as np

from ravenjax import resources
from ravenjax.numbers import Scalar, Vec, for_each_arm, record
from ravenjax.robots.raven2.arms import ARMS, ArmName, PerArm
from ravenjax.robots.raven2.setup import RavenSetup

UDP_PORT = 36000
"""Port on which the control software listens; raven2 `network_layer.cpp`."""
U_STRUCT = np.dtype(list(resources.read_tables(__file__, "packet.toml").items()))
"""Layout of a datagram from console to robot, 124 bytes."""
DELTAS, QUATS = ("delx", "dely", "delz"), ("Qx", "Qy", "Qz", "Qw")
"""Names of the fields of `U_STRUCT` for an increment's displacement and rotation."""
V_STRUCT = struct.Struct("<4I7iIi")
"""Layout of a datagram from robot to console, 52 bytes. raven2 declares it, but does not send it,
because NET_SEND is undefined. Fields: sequence, last_sequence, pactyp, version; fx, fy, fz, each of
both arms; runlevel; jointflags; checksum.
"""
SIZE_BYTES = {"increments": U_STRUCT.itemsize, "absolute": 204}
"""Bytes of a datagram, by `RavenSetup.console`. The packet generator of the 2015 fork sends 204
bytes, with two 3x3 rotation matrices in place of two quaternions (raven2_sim
`include/itp_teleoperation.h`, `Real_Packet_Generator.py`).
"""


@record
class Packet:
    """A packet that the robot receives. Tuples have one entry per arm, gold before green. `delta`
    and `quat` are increments in the ITP frame. With `RavenSetup.console == "absolute"` they are the
    desired position and orientation in the arm's frame 0, and `grasp` is absolute.
    """

    received: Scalar  # int32, 1 if a datagram arrived in this cycle
    size: Scalar  # int32 bytes
    sequence: Scalar  # int32
    delta: PerArm[Vec]  # int32 um (x, y, z)
    quat: PerArm[Vec]  # (x, y, z, w)
    grasp: PerArm[Scalar]  # int32 mrad, positive closes
    surgeon_mode: Scalar  # int32, 1 pedal down


@functools.lru_cache(maxsize=16)
def empty_packet(setup: RavenSetup) -> Packet:
    """Return the packet record of a cycle in which no packet arrives."""
    zero = np.int32(0)
    number = np.dtype(setup.precision.wide).type
    return Packet(
        received=zero,
        size=np.int32(SIZE_BYTES[setup.console]),
        sequence=zero,
        delta=for_each_arm(setup, Vec.full(3, zero)),
        quat=for_each_arm(setup, Vec(map(number, (0.0, 0.0, 0.0, 1.0)))),
        grasp=for_each_arm(setup, zero),
        surgeon_mode=zero,
    )


def fill_fields(fields: Any, packet: Packet, arms: tuple[ArmName, ...]) -> None:
    """Write a packet of these arms into a zeroed datagram (`U_STRUCT`). Other arms do not move."""
    # The int32 becomes the unsigned number with the same bits
    fields["sequence"] = int(packet.sequence) % 2**32
    fields["surgeon_mode"] = int(packet.surgeon_mode)
    fields["Qw"] = 1.0  # no rotation
    for i, arm in enumerate(arms):
        slot = ARMS.index(arm)  # index in each pair of fields
        numbers = *packet.delta[i], *packet.quat[i], packet.grasp[i]
        for name, value in zip((*DELTAS, *QUATS, "grasp"), numbers, strict=True):
            fields[name][slot] = value
