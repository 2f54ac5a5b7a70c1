"""Control software and virtual robot in a loop, driven as the example program of the C library
drives them.
"""

from __future__ import annotations

from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.console.packet import encode, silence


def drive(software, robot, cycles):
    """(output, reading) of each cycle: the pedal down from 0.6 s on, the first arm moving from
    0.9 s on.
    """
    arms, still, reading = software.setup.arms, silence(software.setup), robot.reading
    stays = Vec((0, 0, 0))
    for ms in range(cycles):
        first = Vec((10, 5, 0)) if ms >= 900 else stays
        packet = replace(
            still, sequence=ms + 1, surgeon_mode=int(ms >= 600), delta=(first, stays)[: len(arms)]
        )
        output = software.step(reading.encoders, encode(packet, arms), reading.pins)
        reading = robot.step(output.dac, output.output_pins)
        yield output, reading
