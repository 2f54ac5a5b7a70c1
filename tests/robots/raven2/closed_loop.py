"""Control software and virtual robot in a loop, driven as the example program of the C library
drives them.
"""

import numpy as np

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console.packet import DELTAS, QUATS, U_STRUCT, Packet, empty_packet


def drive(software, robot, cycles):
    """(output, reading) of each cycle: the pedal down from 0.6 s on, the first arm moving from
    0.9 s on.
    """
    arms, still, reading = software.setup.arms, empty_packet(software.setup), robot.reading
    stays = Vec((0, 0, 0))
    for ms in range(cycles):
        first = Vec((10, 5, 0)) if ms >= 900 else stays
        packet = replace(
            still,
            received=1,
            sequence=ms + 1,
            surgeon_mode=int(ms >= 600),
            delta=(first, stays)[: len(arms)],
        )
        output = software.step(reading.encoders, packet, reading.pins)
        reading = robot.step(output.dac, output.output_pins)
        yield output, reading


def decode(datagram, arms):
    """Return the packet of increments in a datagram; missing fields are 0."""
    whole = datagram[: U_STRUCT.itemsize].ljust(U_STRUCT.itemsize, b"\0")
    fields = np.frombuffer(whole, U_STRUCT, count=1)[0]
    slots = [ARMS.index(arm) for arm in arms]
    return Packet(
        received=1,
        size=len(datagram),
        sequence=int(fields["sequence"].view(np.int32)),
        delta=tuple(Vec(int(fields[name][slot]) for name in DELTAS) for slot in slots),
        quat=tuple(Vec(float(fields[name][slot]) for name in QUATS) for slot in slots),
        grasp=tuple(int(fields["grasp"][slot]) for slot in slots),
        surgeon_mode=int(fields["surgeon_mode"]),
    )
