"""What reaches the control software in many cycles: a robot in use, a bad network, glitches, and
any bits at all.
"""

import dataclasses
import random
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import oracle_control_software as oracle
import rig_control_software as rig

from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.software.control_software import ControlSoftware

WORDS = (0, 1, -1, 999, 1000, 2**31 - 1, -(2**31), 2**30)
REALS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-300,
    5e-324,
    1e300,
    -1e308,
    float("inf"),
    float("-inf"),
    float("nan"),
)


@dataclasses.dataclass
class Cycle:
    """Arguments of one `step`."""

    encoders: np.ndarray  # [arms, 7] int32
    packet: Any
    pins: list[int]
    read_ok: list[bool]


class Drive:
    """A robot with two arms in closed loop with `software`; `wild`: how often anything is what
    it should not be.
    """

    def __init__(self, seed: int, software: ControlSoftware, wild: float = 0.01) -> None:
        self.rng, self.software, self.wild = random.Random(seed), software, wild
        setup = software.setup
        fork = setup.software == "fork2015"
        self.absolute = setup.console == "absolute"
        mechs = [
            oracle.Mechanism(ARMS[arm], tool, fork)
            for arm, tool in zip(setup.arms, setup.tools, strict=True)
        ]
        self.motors = [_at_home(mech) for mech in mechs]
        self.console, self.plc = rig.Console(self.rng, bad=True), rig.Plc(self.rng, len(mechs))
        self.sequence = 0

    def cycles(self, count: int) -> Iterator[Cycle]:
        """One cycle after another; the motors obey what `software` last commanded, which the
        caller steps.
        """
        rng = self.rng
        for _ in range(count):
            noise = rng.random() < 0.5
            encoders = np.array([motor.counts(rng, noise) for motor in self.motors], np.int64)
            if rng.random() < self.wild:
                row = encoders[rng.randrange(len(encoders))]
                row[rng.randrange(7)] += rng.choice((30, -200, 3000, -40_000, 2**31 - 1, -(2**31)))
            encoders = np.clip(encoders, -(2**31), 2**31 - 1).astype(np.int32)
            if rng.random() < self.wild / 10:  # the motor itself jumps, and stays there
                self.motors[-1].angle[rng.randrange(7)] += rng.choice((0.5, -20.0))
            yield Cycle(
                encoders,
                self.packets(),
                self.plc.pins(),
                [rng.random() > 0.005 for _ in self.motors],
            )

    def obey(self, dac: tuple[tuple[int, ...], ...]) -> None:
        """The motors take what was commanded."""
        for motor, command in zip(self.motors, dac, strict=True):
            motor.step(command)
            if not all(abs(angle) < 4e4 for angle in motor.angle):  # far beyond any stop
                motor.angle, motor.speed = [0.0] * 7, [0.0] * 7

    def packets(self) -> Any:
        """What arrived: nothing, a datagram, a Packet or several."""
        rng = self.rng
        if self.absolute:
            return [self._packet() for _ in range(rng.choice((0, 1, 1, 1, 2)))]
        many: list[Any] = list(self.console.arrivals())
        while rng.random() < self.wild:
            many.append(rng.choice((self._bits, self._packet, self._hard))())
        return (
            rng.choice((many[0] if len(many) == 1 else many, many))
            if many
            else rng.choice((None, []))
        )

    def _bits(self) -> bytes:
        """Any bits, but a number that may be taken."""
        return struct.pack("<I", self._number()) + self.rng.randbytes(120)

    def _hard(self) -> bytes:
        rng = self.rng
        words, reals = rng.choices(WORDS, k=6), rng.choices(REALS, k=8)
        return struct.pack(
            "<3I6i8d6i", self._number(), 0, 0, *words, *reals, 0, 0, *rng.choices(WORDS, k=2), 1, 0
        )

    def _packet(self) -> Packet:
        rng, arms = self.rng, range(len(self.motors))
        self.sequence += 1
        number = self.sequence if self.absolute else self._number()
        poses = tuple(
            tuple(rng.choice((0, rng.randrange(-200_000, 200_000), *WORDS)) for _ in range(3))
            for _ in arms
        )
        turns = tuple(
            tuple(rng.choice((rng.uniform(-1, 1), *REALS)) for _ in range(4)) for _ in arms
        )
        return Packet(
            1,
            204 if self.absolute else 124,
            number,
            poses,
            turns,
            tuple(rng.choices(WORDS, k=len(arms))),
            1,
        )

    def _number(self) -> int:
        self.console.sequence += 1
        return self.console.sequence % 2**32


ARMS = {"gold": oracle.GOLD, "green": oracle.GREEN}


def _at_home(mech: Any) -> rig.Motors:
    """Motors at the home pose."""
    for _ in range(2):  # the tool motors follow the insertion motor
        oracle.Loop.inverse_coupling(None, mech)  # type: ignore[arg-type]
        mech.joint[oracle.ZI].mpos = mech.joint[oracle.ZI].mpos_d
    joints = [mech.joint[k] for k in oracle.USED]
    return rig.Motors(
        [float(j.mpos_d) for j in joints],
        [j.enc_sign for j in joints],
        [j.tau_sign for j in joints],
    )
