"""Measures how fast the control software alone runs on one core: with one cycle per call, many
cycles per call, and interpreted.

    python analysis/engines/software_alone.py

Real hardware needs 1 000 cycles per second.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

from bench import workload
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console.packet import U_STRUCT, Packet, fill_fields
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.software.control_software import ControlSoftware

PINS = run_levels.PEDAL_DOWN << 6
SWAY_COUNTS = 200
"""Encoder counts by which each motor sways. Numbers then differ from cycle to cycle, and no check
trips.
"""


def measure(seconds: float, cycles: int = 2000, interpreted_cycles: int = 200) -> dict[str, float]:
    """Return cycles per second of both arms with a datagram in each cycle, for each of three ways
    at its best.
    """
    encoders, datagrams = make_inputs(cycles)

    def rate(arithmetic: str, cycles: int, in_a_call: bool) -> float:
        software = make_software(arithmetic)

        def call_each() -> None:
            for counts, datagram in zip(encoders[:cycles], datagrams[:cycles], strict=True):
                software.step(counts, datagram, PINS)

        work: Callable[[], object] = call_each
        if in_a_call:
            work = lambda: software.run(encoders, datagrams, PINS)  # noqa: E731
        work()
        return cycles / min(workload.repeat(work, seconds / 3))

    return {
        "step": rate("compiled", cycles, False),
        "run": rate("compiled", cycles, True),
        "interpreted": rate("interpreted", interpreted_cycles, False),
    }


def make_software(arithmetic: str = "compiled") -> ControlSoftware:
    """Return software with both arms at home and the pedal down."""
    home = [list(HOME_JPOS)] * 2
    return ControlSoftware(jpos=home, runlevel=run_levels.PEDAL_DOWN, arithmetic=arithmetic)


def make_inputs(cycles: int) -> tuple[np.ndarray, list[bytes]]:
    """Return encoders [cycles, arms, 7] that sway around home, and datagrams of small
    increments.
    """
    home = np.array(make_software().state.usb.enc_val)
    phase = np.arange(cycles)[:, None, None] * (2 * math.pi / 500) + np.arange(14).reshape(2, 7)
    encoders = (home + SWAY_COUNTS * np.sin(phase)).astype(np.int32)
    datagrams = []
    for k in range(cycles):
        moves = tuple(
            Vec(round(2 * math.sin(0.01 * k + axis)) for axis in range(3)) for _ in range(2)
        )
        turn = Vec((0.0, 0.0, 1e-4 * math.sin(0.01 * k), 1.0))
        packet = Packet(1, 124, k + 1, moves, (turn, turn), (0, 0), 1)
        datagram = np.zeros((), U_STRUCT)
        fill_fields(datagram, packet, ("gold", "green"))
        datagrams.append(datagram.tobytes())
    return encoders, datagrams


if __name__ == "__main__":
    for way, rate in measure(6.0).items():
        print(f"{way:12} {rate:10,.0f} cycles of both arms a second")
