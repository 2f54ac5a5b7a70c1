"""How many control cycles a packet of the console lasts: named distributions and their
measurements.

`analysis/validation/packets.py` repeats the measurements. The public recordings show:

- recording_gold_joints123 (a real gold arm, 21 s, each row a cycle) has no desired positions, but
  its PD law can be inverted: mpos_d = mpos + (tau + KD mvel) / KP. One DAC count is 0.9 mrad of a
  motor, while a fast motor moves 5 to 20 mrad in a cycle, so a repeated position is visible. While
  the arm moves (7 478 packets) 51 % of rows repeat. Packets do not mix one cycle and many: 92.7 %
  of them last two. Half of the packets that last three cycles are followed by one that lasts one,
  as if a packet missed its cycle. After four cycles the next step is larger than usual, by a third
  at the median. The file cannot distinguish one packet that lasts two cycles from two packets with
  the same position.
- console_itp_packets (a real console, 40 s) has times of arrival. Its packets, too, leave every 2
  ms. But about every 16 ms none arrives for 8 to 9 ms, and then four or five arrive. One third of
  the cycles get packets.
- operator_positions (desired tips, 61 s) never repeats while a hand moves (3 of 50 000 rows), and
  its steps are smooth: either one packet per cycle, or a smoothed recording. Its times of arrival
  are no evidence, because they come in bursts.
- recording_gold_7joints has one row per 4.94 ms and 0.05 % of repeats. It is too coarse to
  distinguish one cycle from four.
"""

from __future__ import annotations

from collections.abc import Sequence

EVERY_CYCLE, MEASURED, BURSTS, OWN = 0, 1, 2, 3

CHOICES = ("every_cycle", "measured", "bursts")
"""Names of the distributions, by number. One more, OWN, is the distribution of the campaign file.
"""

SHARES: tuple[tuple[float, ...], ...] = (
    (1.0,),
    (0.031, 0.927, 0.019, 0.023),  # recording_gold_joints123, motors faster than 4.5 mrad/ms
    (
        0.267,
        0.432,
        0.104,
        0.019,
        0.001,
        0.005,
        0.019,
        0.080,
        0.057,
        0.014,
        0.002,
    ),  # console_itp_packets
)
"""Shares of packets that last 1, 2, 3, .. cycles, for each of CHOICES."""

MOST_CYCLES = 32
"""Number of cycles that the longest packet of a distribution may last."""
QUIET_MS, RELEASE_MS = 250, 2000
"""Silence after which a console counts as gone.

After QUIET_MS a packet with number 1 begins a new stream; after RELEASE_MS any packet does.
"""


def mean_cycles(shares: Sequence[float]) -> float:
    """Return the mean number of cycles that a packet lasts."""
    return sum(cycles * share for cycles, share in enumerate(shares, start=1))
