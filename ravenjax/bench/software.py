"""How fast the control software driven alone is, on one core: a call a cycle, many cycles a
call, and interpreted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from ravenjax.bench import clock
from ravenjax.bench.clock import WorkTiming
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console.packet import Packet, encode
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.software.control_software import ControlSoftware

PINS = run_levels.PEDAL_DOWN << 6
CYCLES, INTERPRETED_CYCLES = 2000, 200
SWAY_COUNTS = 200
"""Encoder counts that each motor sways by: numbers differ from cycle to cycle, and no check
trips.
"""


@dataclasses.dataclass(frozen=True)
class SoftwareSpeed:
    """Both arms, a datagram in each cycle."""

    cycles: int
    interpreted_cycles: int
    calls: WorkTiming  # of `cycles`, a `step` each
    run: WorkTiming  # of `cycles`, one `run`
    interpreted: WorkTiming  # of `interpreted_cycles`, a `step` each

    @property
    def ticks_per_s(self) -> dict[str, float]:
        """Cycles a second of both arms, each way at its best."""
        return {
            "step": self.cycles / self.calls.best_s,
            "run": self.cycles / self.run.best_s,
            "interpreted": self.interpreted_cycles / self.interpreted.best_s,
        }


def measure(
    seconds: float, cycles: int = CYCLES, interpreted_cycles: int = INTERPRETED_CYCLES
) -> SoftwareSpeed:
    """Time the same cycles all three ways, each for about a third of the time."""
    often = clock.REPEATS, seconds / 3
    home = [list(HOME_JPOS)] * 2
    one, many, slow = (
        ControlSoftware(jpos=home, runlevel=run_levels.PEDAL_DOWN, arithmetic=way)
        for way in ("compiled", "compiled", "interpreted")
    )
    encoders, datagrams = inputs(np.array(one.state.usb.enc_val), cycles)
    few = slice(interpreted_cycles)

    def steps(
        software: ControlSoftware, encoders: np.ndarray, packets: Sequence[bytes]
    ) -> Callable[[], None]:
        def work() -> None:
            for counts, packet in zip(encoders, packets, strict=True):
                software.step(counts, packet, PINS)

        return work

    return SoftwareSpeed(
        cycles,
        interpreted_cycles,
        clock.timed(steps(one, encoders, datagrams), *often),
        clock.timed(lambda: many.run(encoders, datagrams, PINS), *often),
        clock.timed(steps(slow, encoders[few], datagrams[few]), *often),
    )


def inputs(home: np.ndarray, cycles: int) -> tuple[np.ndarray, list[bytes]]:
    """Encoders [cycles, arms, 7] that sway around `home`, and small increments."""
    phase = np.arange(cycles)[:, None, None] * (2 * math.pi / 500) + np.arange(14).reshape(2, 7)
    encoders = (home + SWAY_COUNTS * np.sin(phase)).astype(np.int32)

    def datagram(k: int) -> bytes:
        moves = tuple(
            Vec(round(2 * math.sin(0.01 * k + axis)) for axis in range(3)) for _ in range(2)
        )
        turn = Vec((0.0, 0.0, 1e-4 * math.sin(0.01 * k), 1.0))
        packet = Packet(1, 124, k + 1, moves, (turn, turn), (0, 0), 1)
        return encode(packet, ("gold", "green"))

    return encoders, [datagram(k) for k in range(cycles)]
