"""A network channel of four qualities that loses packets in bursts and delivers them late: seeded,
else ideal.

The emulator of UVA-DSA's Activity-Aware-Recovery (network/interception.py, config.json), packet by
packet:

- its quality moves between good, bad and two between by TRANSITIONS; it begins good;
- a packet outside a burst begins one with the LOSS of the quality of then. A burst takes that
  packet and floor(L) more, L of a Pareto distribution, alpha 1.5, scale 2: so it goes on after its
  k-th packet, k >= 3, with probability ((k - 1) / k) ** 1.5, which needs no length drawn
  beforehand;
- a packet is late by a delay of 10 to 100 ms and a jitter of 1 to 10 ms, both uniform.

Simplified: one packet arrives at a time, and the delay is drawn for the moment of arrival rather
than for the packet: what arrives is the packet sent so long ago, if nothing newer was there before.
Packets that others overtook are thus lost, as they are by the robot's sequence rule. The emulator's
loss of the whole connection is fault effect `drop`.
"""

from __future__ import annotations

from ravenjax.numbers.counter_random import uniform
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.vec import Scalar, as_int, record, where

TRANSITIONS = (
    (0.95, 0.02, 0.02, 0.01),
    (0.01, 0.94, 0.03, 0.02),
    (0.02, 0.03, 0.90, 0.05),
    (0.01, 0.02, 0.07, 0.90),
)
"""From a quality (row) to the next: good, bad, intermediate 1 and 2."""
LOSS = (0.01, 0.1, 0.05, 0.08)
"""Probability that a packet begins a burst, by quality."""
SURE = 2
"""Packets that a burst takes at least after its first: the scale of the Pareto distribution,
whose alpha is 1.5.
"""
DELAY_MS, JITTER_MS = (10.0, 100.0), (1.0, 10.0)

_QUALITY, _GOES_ON, _BEGINS, _DELAY, _JITTER = range(5)
"""Places of the draws in the stream of a packet."""


@record
class ChannelState:
    """What the channel remembers from packet to packet."""

    quality: Scalar  # int32, row of TRANSITIONS
    burst: Scalar  # int32, packets in a row lost to the burst that lasts; 0: none does


def init() -> ChannelState:
    """Good, and no burst."""
    return ChannelState(jnp.int32(0), jnp.int32(0))


def step(state: ChannelState, seed: Scalar, packet: Scalar, fresh: Scalar) -> ChannelState:
    """The channel after the packet of this cycle, of index `packet` (int32), where it is `fresh`
    (bool).

    seed: float, one for each channel or a new one in each cycle; 0: an ideal channel, which forgets
    what it was.
    """
    key = _key(seed)
    quality = _next(state.quality, uniform(key, packet, _QUALITY))
    fewer, lost = (
        lax.convert_element_type(jnp.maximum(k, SURE), jnp.float32)
        for k in (state.burst - 1, state.burst)
    )
    share = fewer / lost
    goes_on = (state.burst > 0) & (uniform(key, packet, _GOES_ON) < share * jnp.sqrt(share))
    begins = uniform(key, packet, _BEGINS) < _of(quality, LOSS)
    burst = jnp.where(goes_on, state.burst + 1, as_int(begins))
    moved = where(fresh, ChannelState(quality, burst), state)
    return where(seed != 0.0, moved, init())


def delay_ms(seed: Scalar, packet: Scalar) -> Scalar:
    """How old in ms (int32) what arrives is when packet `packet` is sent; `seed` as in `step`."""
    delay = jnp.float32(0.5)  # to the nearest millisecond
    for place, (least, most) in ((_DELAY, DELAY_MS), (_JITTER, JITTER_MS)):
        delay = delay + least + (most - least) * uniform(_key(seed), packet, place)
    return jnp.where(seed != 0.0, as_int(delay), 0)


def _key(seed: Scalar) -> Scalar:
    return lax.bitcast_convert_type(lax.convert_element_type(seed, jnp.float32), jnp.uint32)


def _of(quality: Scalar, numbers: tuple[float, ...]) -> Scalar:
    """The one of `numbers` that belongs to a quality, float32."""
    number_of = jnp.float32(numbers[0])
    for k, number in enumerate(numbers[1:], start=1):
        number_of = jnp.where(quality == k, jnp.float32(number), number_of)
    return number_of


def _next(quality: Scalar, drawn: Scalar) -> Scalar:
    """The quality after this one, int32: how many of its row's partial sums are below `drawn`,
    in [0, 1).
    """
    partial = tuple(zip(*(_partial_sums(row) for row in TRANSITIONS), strict=True))
    return sum((as_int(drawn >= _of(quality, sums)) for sums in partial), jnp.int32(0))


def _partial_sums(row: tuple[float, ...]) -> list[float]:
    return [sum(row[: k + 1]) for k in range(len(row) - 1)]
