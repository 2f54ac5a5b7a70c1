"""The square wave and the output byte."""

from __future__ import annotations

import itertools

import numpy as np

from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import watchdog


def wave(ticks, soft_estopped=lambda tick: 0, state=None):
    state = state or watchdog.init(RavenSetup())
    high = []
    for tick in range(ticks):
        state, pins = watchdog.step(state, np.int32(soft_estopped(tick)), *map(np.int32, (3, 1, 1)))
        high.append(bool(int(pins) & 16))
    return state, high


def test_first_26_then_25_cycles_high_and_25_low():
    _, high = wave(180)
    runs = [1]
    for before, now in itertools.pairwise(high):
        runs = [*runs, 1] if now != before else [*runs[:-1], runs[-1] + 1]
    assert high[0]
    assert runs == [26, 25, 25, 25, 25, 25, 25, 4]


def test_bits_of_the_output_byte():
    state = watchdog.init(RavenSetup())
    for level, mode, ready, expected in (
        (3, 1, 1, 0b11111),
        (2, 0, 1, 0b11010),
        (1, 1, 0, 0b10001),
        (2, 7, 0, 0b10110),
    ):
        _, pins = watchdog.step(state, np.int32(0), *map(np.int32, (level, mode, ready)))
        assert int(pins) == expected
