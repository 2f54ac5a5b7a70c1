"""A console's good packets among all kinds of bad ones, and where the tip must stand after them."""

import math
import random

from itp_client import IDENTITY, datagram

from ravenjax.train.robot_link.packet_filter import CAUSES

BOOKED = set(CAUSES) - {"restart", "buttons", "undecided"}
"""What can become of a packet of `Books`: it never starts anew, sends each jaw once, and is read
by one profile.
"""


def turned(angle):
    return (math.sin(angle / 2), 0.0, 0.0, math.cos(angle / 2))


class Books:
    """The oracle: where the tips must stand, kept by who knows which packets are the console's own
    and in order.

    Bad packets are bad on the gold side, so that they are for a robot with that arm alone too.
    """

    def __init__(self, seed, pedal=(0, 1), step=200):
        """pedal: what the console's packets may say of it. step: um, the longest along an axis."""
        self.random = random.Random(seed)
        self.pedal, self.step = pedal, step
        self.sequence = 0  # of the console's newest packet
        self.lost = False  # the next one comes after a gap
        self.um = [0, 0, 0, 0, 0, 0]
        self.history = []

    def good(self):
        """The console's next packet; the oracle moves with it, unless a gap comes before it."""
        self.sequence += 1
        step = [self.random.randint(-self.step, self.step) for _ in range(6)]
        packet = datagram(
            self.sequence,
            gold=step[:3],
            green=step[3:],
            surgeon_mode=self.random.choice(self.pedal),
        )
        if not self.lost:
            self.um = [a + b for a, b in zip(self.um, step, strict=True)]
        self.lost = False
        self.history = [*self.history[-500:], packet]
        return packet if self.sequence % 7 else packet + bytes(400)  # oversized: the robot cuts it

    def next(self, **fields):
        """A packet in the console's name and with its next number, which it never sent."""
        return datagram(self.sequence + 1, **({"gold": (900, 0, 0)} | fields))

    def bad(self):
        """Datagrams that must move nothing, and whether they come from somewhere else."""
        pick, nan = self.random.choice, math.nan
        kind = self.random.randrange(14)
        if kind == 0:
            return [self.random.randbytes(self.random.randrange(600))], False
        if kind == 1:
            return [self.next()[: self.random.randrange(124)]], False
        if kind == 2:
            return [
                self.next(quats=((nan, 0.0, 0.0, 1.0), IDENTITY)),
                self.next(quats=((0.0,) * 4, IDENTITY)),
            ], False
        if kind == 3:
            return [self.next(gold=(pick((-1001, 2**31 - 1, -(2**31))), 0, 0))], False
        if kind == 4:
            return [self.next(surgeon_mode=pick((-1, 2, 2**31 - 1)))], False
        if kind == 5:
            return [
                self.next(grasp=(pick((201, -(2**31))), 0)),
                self.next(quats=(turned(3.0), IDENTITY)),
            ], False
        if kind == 6:
            return self.random.choices(self.history or [b""], k=20), False  # replayed
        if kind == 7:
            return self.history, False  # replayed from the beginning
        if kind == 8:
            return [self.next()] * 50, True  # a flood from elsewhere
        if kind == 9:
            return [
                datagram(0, gold=(900, 0, 0)),
                datagram(self.sequence + 5000, gold=(900, 0, 0)),
            ], False
        if kind == 10:
            return (
                [
                    datagram(1, gold=(900, 0, 0)),
                    datagram(2, gold=(900, 0, 0)),
                ]
                if self.sequence > 9
                else []
            ), False
        if (
            kind == 11
            # two packets change places: the later one is lost for the gap, the earlier one for its
            # lateness
        ):
            self.sequence += 2
            return [
                datagram(self.sequence, gold=(7, 7, 7)),
                datagram(self.sequence - 1, gold=(9, 9, 9)),
            ], False
        if kind == 12:  # a bit of the checksum, or of what it covers
            packet = bytearray(self.next())
            packet[pick((12, 20, 28, 100, 120, 123))] ^= 1 << self.random.randrange(8)
            return [bytes(packet)], False
        self.sequence += self.random.randrange(
            1, 9
        )  # packets lost on the way, and with them the next
        self.lost = True
        return [], False
