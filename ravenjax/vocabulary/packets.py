"""Defines how many control cycles a console's packet lasts: distributions and measurements.
docs/explanation/simulated.md describes the measurements; `analysis/validation/packets.py` repeats
them on public recordings.

The file recording_gold_joints123 contains DAC commands, from which the desired position of a motor
follows to 0.9 mrad. While a motor moves fast, this position changes by 5 to 20 mrad in a cycle. So
a packet that lasts two cycles is visible as a repeated position. Two packets with equal positions
look the same. Packets of the file operator_positions arrive in bursts, so this file is no evidence.
"""

from collections.abc import Sequence

import numpy as np

from ravenjax import resources

EVERY_CYCLE, MEASURED, BURSTS, OWN = 0, 1, 2, 3

_TABLE = resources.read_tables(__file__, "packets.toml")

CHOICES = tuple(_TABLE)
"""Names of the distributions, by number. OWN is the number of a distribution in a campaign file."""

SHARES: tuple[tuple[float, ...], ...] = tuple(map(tuple, _TABLE.values()))
"""Shares of packets that last 1, 2, 3, .. cycles, for each of CHOICES."""

MOST_CYCLES = 32
"""Largest number of cycles of a packet in a distribution."""
QUIET_MS, RELEASE_MS = 250, 2000
"""Times without a packet after which a console may begin a new stream, ms.

After QUIET_MS a packet with number 1 begins a new stream, after RELEASE_MS any packet.
"""
_STEPS = 1000


def mean_cycles(shares: Sequence[float]) -> float:
    """Return the mean number of control cycles of a packet. shares: as an entry of SHARES."""
    return sum(cycles * share for cycles, share in enumerate(shares, start=1))


def packet_lengths(ms: np.ndarray) -> np.ndarray:
    """Return the number of cycles from each cycle with datagrams to the next such cycle, int.
    ms: arrival times of the datagrams, ascending. A cycle lasts 1 ms.
    """
    return np.diff(np.unique(np.floor(ms)).astype(int))


def length_shares(cycles: np.ndarray) -> np.ndarray:
    """Return the shares of packets that last 1, 2, 3, .. cycles. cycles: int [n], lengths."""
    return np.bincount(cycles)[1:] / len(cycles)


def rounded_shares(cycles: np.ndarray) -> tuple[float, ...]:
    """Return `length_shares` for a campaign file: rounded to multiples of 0.001 with the sum 1.
    Packets that are longer than allowed count as packets of the largest allowed length.
    """
    exact = length_shares(np.minimum(cycles, MOST_CYCLES)) * _STEPS
    # Round down, then add 0.001 to the shares with the largest remainders until the sum is 1.
    thousandths = np.floor(exact).astype(int)
    thousandths[np.argsort(thousandths - exact)[: _STEPS - thousandths.sum()]] += 1
    longest = np.flatnonzero(thousandths)[-1] + 1
    return tuple((thousandths[:longest] / _STEPS).tolist())
