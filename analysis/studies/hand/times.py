"""Measured reaction times, and what an operator of each avoids who lifts the pedal at the cue."""

from __future__ import annotations

from typing import NamedTuple


class MeasuredTime(NamedTuple):
    """One published time from a stimulus to an action."""

    stimulus: str
    ms: float
    source: str
    applies: str  # to whom


MEASURED = (
    MeasuredTime(
        "touch, expected, one response",
        155.0,
        "Robinson 1934, in Kosinski, A Literature Review on Reaction Time, Clemson University",
        "laboratory, hand on a key: the fastest that a cue can be",
    ),
    MeasuredTime(
        "sight, expected, one response",
        190.0,
        "180 to 200 ms, Welford 1980 and others in Kosinski's review; sound 140 to 160 ms",
        "laboratory: an operator who sees the instrument move and waits for it",
    ),
    MeasuredTime(
        "recognition, one response to some stimuli and none to others",
        384.0,
        "Laming 1968, in Kosinski's review; simple reactions of the same study 220 ms",
        "an operator who must tell a cue from another force",
    ),
    MeasuredTime(
        "brake light, time and place known, foot moves to the brake",
        725.0,
        "0.70 to 0.75 s, Green, Transportation Human Factors 2(3), 2000",
        "a foot that acts while the hands are busy, warned",
    ),
    MeasuredTime(
        "unexpected but common signal, foot moves to the brake",
        1250.0,
        "Green 2000",
        "an operator who knows the cue and does not wait for it",
    ),
    MeasuredTime(
        "surprise, foot moves to the brake",
        1500.0,
        "Green 2000; 1.0 to 1.3 s where it is urgent (Summala, Transportation Human Factors 2(3),"
        " 2000)",
        "an operator who has never had a cue",
    ),
)
"""By time. Nobody has measured surgeons at this cue. Drivers' times hold the foot's way from one
pedal to the other.
"""

DEFAULT_MS = 250.0
"""Of `[reaction] delay_ms`, assumed."""

DELAYS_MS = tuple(sorted({*(one.ms for one in MEASURED), DEFAULT_MS}))
