"""How a recording becomes a motion: the keys of [operator] that only a recorded one has."""

from __future__ import annotations

import dataclasses
from typing import Literal

Spikes = Literal["refuse", "remove", "replay"]
AtEnd = Literal["refuse", "hold", "reverse"]

MAX_GAP_S = 0.1
"""s between two samples; hands move some millimetres in it."""


@dataclasses.dataclass(frozen=True)
class ReplayOptions:
    """Each changes the recording in one way; the defaults change nothing."""

    rate_hz: float | None = None  # rows a second, evenly spaced; None: by the file's time stamps
    window_s: tuple[float, float] | None = (
        None  # part that is replayed, s; None: from the first row on
    )
    cutoff_hz: float | None = None  # of the low-pass; None: no filter
    slow_down: float = 1.0  # how much slower than recorded it is replayed
    max_gap_s: float = MAX_GAP_S  # longer gaps between samples are refused where they are replayed
    spikes: Spikes = "refuse"  # tips that jump
    console: str = (
        "auto"  # profile of a stream of packets, as `store.consoles.loading.choice` has it
    )
    at_end: AtEnd = "refuse"  # where the recording ends before the run
