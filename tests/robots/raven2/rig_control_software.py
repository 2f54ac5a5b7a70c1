"""A rough rig around the control software: motors that obey its DACs, a misbehaving PLC, a console
that loses packets.

Independent of the package. Everything is drawn from one seed, so two programs can be driven side by
side.
"""

import math
import struct

COUNTS_PER_RAD = 4000 / (2 * math.pi)


class Motors:
    """Seven motors of one arm: torque from the DAC, viscous friction, whole encoder counts."""

    def __init__(self, angles, enc_sign, tau_sign):
        self.angle, self.speed = list(angles), [0.0] * 7
        self.enc_sign, self.tau_sign = enc_sign, tau_sign

    def step(self, dac):
        for i in range(7):
            inertia, drag, per_count = (3e-4, 4e-3, 2.7e-4) if i < 3 else (6e-5, 1.5e-3, 3.7e-5)
            torque = dac[i] * self.tau_sign[i] * per_count
            self.speed[i] += 1e-3 * (torque - drag * self.speed[i]) / inertia
            self.angle[i] += 1e-3 * self.speed[i]

    def counts(self, rng, noise):
        return [
            round(sign * angle * COUNTS_PER_RAD) + (rng.choice((-1, 0, 1)) if noise else 0)
            for sign, angle in zip(self.enc_sign, self.angle, strict=True)
        ]


def datagram(sequence, moves, quats, grasps, surgeon_mode):
    """124 bytes; two entries each, gold first."""
    columns = [int(m[k]) for k in range(3) for m in moves]
    turns = [q[k] for k in range(4) for q in quats]
    return struct.pack(
        "<3I6i8d6i", sequence % 2**32, 0, 0, *columns, *turns, 0, 0, *grasps, surgeon_mode, 0
    )


class Console:
    """Increments that wander and sometimes drive on into the limits, through a bad network."""

    def __init__(self, rng, bad):
        self.rng, self.bad = rng, bad
        self.sequence = 0
        self.velocity = [[0.0] * 3, [0.0] * 3]
        self.spin = [[0.0] * 3, [0.0] * 3]
        self.sent = []
        self.mode, self.mute = 1, 0

    def arrivals(self):
        """The datagrams of one cycle."""
        rng = self.rng
        if rng.random() < 0.004:
            push = rng.choice((0, 60, 150, 400))
            self.velocity = [[rng.uniform(-push, push) for _ in range(3)] for _ in range(2)]
            turn = rng.choice((0, 0.0005, 0.003, 0.01))
            self.spin = [[rng.uniform(-turn, turn) for _ in range(3)] for _ in range(2)]
        if rng.random() < 0.001:
            self.mode = 1 - self.mode
        self.sequence += 1
        quats = []
        for spin in self.spin:
            size = rng.choice((1.0, 1.0, 1.0, 0.97, 2.5))
            quats.append(
                [size * s / 2 for s in spin]
                + [size * math.sqrt(max(0.0, 1 - sum(s * s for s in spin) / 4))]
            )
        grasps = [rng.choice((0, 0, 0, 5, -5, 40, -40)) for _ in range(2)]
        data = datagram(self.sequence, self.velocity, quats, grasps, self.mode)
        self.sent.append(data)
        if not self.bad:
            return [data]
        if self.mute > 0:
            self.mute -= 1
            return []
        draw = rng.random()
        if draw < 0.010:
            return []
        if draw < 0.014:
            return [data, data]
        if draw < 0.018:
            return [data[: rng.randrange(124)]]
        if draw < 0.022:
            return [data + bytes(rng.randrange(1, 200))]
        if draw < 0.026:
            return [data, self.sent[rng.randrange(len(self.sent))]]
        if draw < 0.028:
            return [datagram(0, self.velocity, quats, grasps, self.mode)]
        if draw < 0.0283:
            return [datagram(self.sequence, self.velocity, [[0.0] * 4] * 2, grasps, self.mode)]
        if draw < 0.0288:
            self.sequence = rng.choice(
                (0, 5, self.sequence + 3, self.sequence - 1500, 2**31 + 7, 2**32 - 2)
            )
        return [data]


class Plc:
    """Run level on the pins: mostly pedal-down, with pedals, glitches, E-stops and restarts."""

    def __init__(self, rng, boards):
        self.rng, self.boards = rng, boards
        self.plan = [(0, 6), (1, 40), (2, 15)]
        self.glitch = 0

    def pins(self):
        rng = self.rng
        if not self.plan:
            draw = rng.random()
            if draw < 0.35:
                self.plan = [
                    (0, rng.randrange(3, 40)),
                    (1, rng.randrange(2, 30)),
                    (2, rng.randrange(3, 30)),
                ]
            elif draw < 0.5:
                self.plan = [(1, rng.randrange(3, 40))]
            elif draw < 0.75:
                self.plan = [(2, rng.randrange(3, 60))]
            self.plan.append((3, rng.randrange(50, 700)))
        level, left = self.plan[0]
        self.plan[0] = (level, left - 1)
        if left <= 1:
            self.plan.pop(0)
        if rng.random() < 0.01:
            level = rng.randrange(4)
        byte = level << 6
        return [
            byte | rng.randrange(64) if rng.random() > 0.002 else rng.randrange(256)
            for _ in range(self.boards)
        ]
