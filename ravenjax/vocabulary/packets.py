"""Defines how many control cycles a console's packet lasts: distributions and measurements.
docs/explanation/simulated.md describes the measurements; `analysis/validation/packets.py` repeats
them on public recordings.

The file recording_gold_joints123 contains DAC commands, from which the desired position of a motor
follows to 0.9 mrad. While a motor moves fast, this position changes by 5 to 20 mrad in a cycle. So
a packet that lasts two cycles is visible as a repeated position. Two packets with equal positions
look the same. Packets of the file operator_positions arrive in bursts, so this file is no evidence.
"""

from collections.abc import Sequence

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


def mean_cycles(shares: Sequence[float]) -> float:
    """Return the mean number of control cycles of a packet. shares: as an entry of SHARES."""
    return sum(cycles * share for cycles, share in enumerate(shares, start=1))
