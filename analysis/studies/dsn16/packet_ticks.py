"""When each packet of a run comes: faults and published logs count packets, simulated runs count
milliseconds.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ravenjax.campaign.plan import Plan
from ravenjax.numbers.lazy import jnp
from ravenjax.robots.raven2.campaign.config import of_raven
from ravenjax.robots.raven2.campaign.program import PACKET_KEY, PACKETS
from ravenjax.stages import packet_clock

CYCLES = "network.cycles_per_packet"


@dataclasses.dataclass(frozen=True, eq=False)
class PacketTicks:
    """Of the runs of a campaign, in its order, as if nothing ever stopped them; packets count
    from 1.
    """

    ticks: np.ndarray  # int32 [runs, packets] at which each comes, ascending
    # a packet is of the hand's place at its tick; else each is of the next row of the motion
    by_time: bool

    def packet(self, index: np.ndarray, tick: np.ndarray) -> np.ndarray:
        """Number of the newest packet in run `index` [n] at `tick` [n] (ms); 0 where the tick is
        negative.
        """
        return np.array(
            [
                np.searchsorted(self.ticks[row], t, side="right")
                for row, t in zip(index, tick, strict=True)
            ],
            int,
        )

    def motion_row(self, index: np.ndarray, packet: np.ndarray) -> np.ndarray:
        """Row of the motion, a row a ms, that packet `packet` [n] of run `index` [n] is made of."""
        place = np.asarray(packet, int) - 1
        return self.ticks[index, place] if self.by_time else place


def of(ready: Plan) -> PacketTicks:
    """Of a campaign that is planned. ValueError where its runs have several distributions."""
    runs, length = ready.runs, ready.config.campaign.ticks
    if PACKETS in ready.varied:
        raise ValueError(f"expected one distribution of packets for all runs, got varied {PACKETS}")
    if PACKET_KEY not in ready.varied:
        return regular(runs, length, _cycles(ready))
    return drawn(of_raven(ready.config).campaign.packet_shares, ready.varied[PACKET_KEY], length)


def regular(runs: int, length: int, cycles: int = 1) -> PacketTicks:
    """Of `runs` runs of `length` ms in which each packet lasts `cycles`."""
    ticks = np.arange(0, length, cycles, dtype=np.int32)
    return PacketTicks(np.broadcast_to(ticks, (runs, len(ticks))), by_time=False)


def drawn(shares: tuple[float, ...], keys: np.ndarray, length: int) -> PacketTicks:
    """Of runs with these packet keys (uint32 [runs]) and lengths that have `shares`, for
    `length` ms.
    """
    packets = jnp.arange(length, dtype=jnp.int32)  # as many as there can be
    cycles = packet_clock.length(
        (shares,), np.int32(0), jnp.asarray(keys)[:, None], packets[None, :]
    )
    after = np.cumsum(np.asarray(cycles), axis=1, dtype=np.int32)
    ticks = np.concatenate([np.zeros((len(keys), 1), np.int32), after[:, :-1]], axis=1)
    return PacketTicks(ticks[:, : int((ticks < length).sum(axis=1).max())], by_time=True)


def _cycles(ready: Plan) -> int:
    axis = ready.config.parameters.get(CYCLES)
    return 1 if axis is None else int(axis.values[0])
