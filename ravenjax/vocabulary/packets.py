"""How many control cycles a packet of the console lasts: distributions by name, and what they were
measured on.

`analysis/validation/packets.py` measures them again. What the public recordings tell:

- recording_gold_joints123 (a real gold arm, 21 s, each row a cycle) has no desired positions, but
  its PD law can be inverted: mpos_d = mpos + (tau + KD mvel) / KP. One DAC count is 0.9 mrad of a
  motor, while a fast motor moves 5 to 20 mrad in a cycle, so a repeat shows. While the arm moves (7
  478 packets) 51 % of rows repeat. That is no mixture of one cycle and many: 92.7 % of packets last
  two. Half of those that last three are followed by one that lasts one, as where a packet misses
  its cycle; after four cycles the next step is larger than usual, by a third at the median. The
  file cannot tell a packet that lasts two cycles from two packets with the same position.
- console_itp_packets (a real console, 40 s) has times of arrival. Its packets, too, leave every 2
  ms; but every 16 ms or so none arrives for 8 to 9 ms, and then four or five do. One third of the
  cycles get packets.
- operator_positions (desired tips, 61 s) never repeats while a hand moves (3 of 50 000 rows), and
  its steps are smooth: one packet a cycle, or a recording that was smoothed. Its times of arrival
  say nothing: they come in bursts.
- recording_gold_7joints has a row each 4.94 ms and 0.05 % of repeats: too coarse to tell one cycle
  from four.
"""

from __future__ import annotations

from collections.abc import Sequence

EVERY_CYCLE, MEASURED, BURSTS, OWN = 0, 1, 2, 3

CHOICES = ("every_cycle", "measured", "bursts")
"""Distributions with a name, by number; one more, OWN, is that of the campaign file."""

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
"""For each of CHOICES, the shares of packets that last 1, 2, 3, .. cycles."""

MOST_CYCLES = 32
"""The longest packet of a distribution."""
QUIET_MS, RELEASE_MS = 250, 2000
"""Silence after which a console counts as dead. After QUIET_MS a packet of number 1 begins a new
stream, after RELEASE_MS any packet does.
"""


def mean(shares: Sequence[float]) -> float:
    """Cycles that a packet lasts at the mean."""
    return sum(cycles * share for cycles, share in enumerate(shares, start=1))
