"""What a recording holds and what became of it: what the manifest keeps, the terminal prints and
the report shows.
"""

from __future__ import annotations

import itertools

import numpy as np
from pydantic import BaseModel, ConfigDict

POINTS = 200
"""Stretches of a picture's lines; each is drawn from its least to its greatest value, so that no
spike is lost.
"""


class ArmSummary(BaseModel):
    """The tip of one arm."""

    model_config = ConfigDict(frozen=True)

    arm: str
    orientation: str  # "recorded" or "home"
    jaws: str  # "recorded" or "home"
    inside: float  # share of the recording inside the joint limits
    extent_mm: tuple[float, float, float]  # of what is replayed, frame 0
    path_mm: float  # of what is replayed
    fastest_mm_s: float  # of what is replayed
    distance_mm: tuple[float, float]  # from the remote centre, of what is replayed
    removed_rms_mm: float | None = None  # by the low-pass, of what is replayed
    removed_largest_mm: float | None = None
    removed_largest_s: float | None = None  # when, s in the recording


class TipLine(BaseModel):
    """A curve of the picture: numbers as text, so that a manifest stays a page of lines."""

    model_config = ConfigDict(frozen=True)

    arm: str
    what: str  # "recorded", or "replayed" for the stretch that a campaign uses
    time_ms: str  # in the recording
    x_um: str
    y_um: str
    z_um: str

    def numbers(self, name: str) -> list[float]:
        """One of the columns."""
        return [float(word) for word in getattr(self, name).split()]


class MotionSummary(BaseModel):
    """One recorded operator. Times are seconds in the recording unless they say otherwise; rows
    count from 0.
    """

    model_config = ConfigDict(frozen=True)

    file: str
    sha256: str
    rows: int  # of the first arm
    clock: str  # where times come from
    read: tuple[str, ...]  # columns or topics
    ignored: tuple[str, ...]  # the others
    notes: tuple[str, ...]  # what else a reader should know
    duration_s: float
    rate_hz: float  # mean
    steps_ms: tuple[float, float, float]  # between samples: least, median, greatest
    gaps: int  # steps of more than three median ones
    gap_s: float | None = None  # longest of them
    gap_row: int | None = None  # after which row
    gap_begin_s: float | None = None
    max_gap_s: float
    spikes: tuple[str, ...]  # each in words
    spike_treatment: str  # of ravenjax.store.motion.options.Spikes
    cutoff_hz: float | None
    outside: tuple[tuple[float, float], ...]  # stretches that cannot be replayed, the longest first
    outside_share: float  # of the recording
    window_s: tuple[float, float]  # that is replayed
    window_stated: bool  # by the campaign; else from the first row on
    slow_down: float
    campaign_s: float  # length of the motion
    rest_s: float
    run_up_s: float
    at_end: str  # of ravenjax.store.motion.options.AtEnd
    end_s: (
        float | None
    )  # of the campaign: when the recording ended and hands stopped or turned; None: it did not
    turns: int  # how often it was played in the other direction after that
    pedal: str  # "recorded" or "down"
    pedal_down: float  # share of the campaign
    scale: float  # teleoperation scale at which the tip moves as recorded
    scales: tuple[float, float] | None = None  # least and greatest that a campaign varies it to
    arms: tuple[ArmSummary, ...]
    lines: tuple[TipLine, ...]


def line(arm: str, what: str, time_s: np.ndarray, position: np.ndarray) -> TipLine:
    """The curve of positions [T, 3] m, thinned to the least and the greatest value of each of
    POINTS stretches.
    """
    edges = np.unique(np.linspace(0, len(time_s), POINTS + 1).round().astype(int))
    time, columns = [], ([], [], [])
    for begin, end in itertools.pairwise(edges.tolist()):
        time += [time_s[begin], time_s[end - 1]]
        for axis, column in enumerate(columns):
            some = position[begin:end, axis]
            low, high = int(np.argmin(some)), int(np.argmax(some))
            column += [some[min(low, high)], some[max(low, high)]]
    x, y, z = (" ".join(f"{value * 1e6:.0f}" for value in column) for column in columns)
    return TipLine(
        arm=arm,
        what=what,
        time_ms=" ".join(f"{value * 1e3:.0f}" for value in time),
        x_um=x,
        y_um=y,
        z_um=z,
    )
