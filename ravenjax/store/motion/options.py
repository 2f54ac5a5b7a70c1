"""Options of the conversion from a recording to a motion: the keys of [operator] for recordings
only.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

Spikes = Literal["refuse", "remove", "replay"]
AtEnd = Literal["refuse", "hold", "reverse"]

MAX_GAP_S = 0.1
"""Default of the longest gap between two samples, s. Hands move some millimetres in it."""


@dataclasses.dataclass(frozen=True)
class ReplayOptions:
    """Each option changes the recording in one way; the defaults change nothing."""

    rate_hz: float | None = None  # rows per second, evenly spaced; None: by the file's time stamps
    # Part that is replayed, s; None: from the first row on.
    window_s: tuple[float, float] | None = None
    cutoff_hz: float | None = None  # of the low-pass; None: no filter
    slow_down: float = 1.0  # how much slower than recorded it is replayed
    # Longer gaps between samples are refused in the replayed part.
    max_gap_s: float = MAX_GAP_S
    # What happens at tips that jump.
    spikes: Spikes = "refuse"
    # Profile of a stream of packets, as `store.consoles.loading.choice` takes it.
    console: str = "auto"
    # What happens if the recording ends before the run.
    at_end: AtEnd = "refuse"
