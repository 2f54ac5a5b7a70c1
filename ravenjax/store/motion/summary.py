"""Summarises a recording and the motion made from it, for the manifest, the terminal and the
report.

The texts are in summary.j2.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from ravenjax.bundled import resources
from ravenjax.store.motion.options import ReplayOptions


class ArmSummary(BaseModel):
    """The tip of one arm. All fields except `inside` describe the replayed part."""

    model_config = ConfigDict(frozen=True)

    arm: str
    orientation: str  # "recorded" or "home"
    jaws: str  # "recorded" or "home"
    inside: float  # share of the recording inside the joint limits
    extent_mm: tuple[float, float, float]  # in frame 0
    path_mm: float
    fastest_mm_s: float
    distance_mm: tuple[float, float]  # from the remote centre
    # Removed by the low-pass filter: root mean square (mm), largest value (mm), and its time in the
    # recording (s).
    removed: tuple[float, float, float] | None = None


class MotionSummary(BaseModel):
    """One recorded operator.

    Times are seconds in the recording unless stated otherwise. Rows count from 0.
    """

    model_config = ConfigDict(frozen=True)

    file: str
    sha256: str
    options: ReplayOptions
    rows: int  # of the first arm
    clock: str  # source of the times
    read: tuple[str, ...]  # columns or topics
    ignored: tuple[str, ...]  # the others
    notes: tuple[str, ...]  # further notes
    duration_s: float
    rate_hz: float  # mean
    steps_ms: tuple[float, float, float]  # between samples: least, median, greatest
    gaps: int  # steps of more than three median ones
    longest_gap: tuple[int, float, float] | None  # row before it, begin, length in s
    spikes: tuple[str, ...]  # each in words
    # Stretches that cannot be replayed, the longest first.
    outside: tuple[tuple[float, float], ...]
    outside_share: float  # share of the recording
    window_s: tuple[float, float]  # the replayed part
    campaign_s: float  # length of the motion
    # Time in the campaign when the recording ended and the hands stopped or reversed, s; None: it
    # did not end.
    end_s: float | None
    turns: int  # how often the direction was reversed after that
    pedal: str  # "recorded" or "down"
    pedal_down: float  # share of the campaign
    # Teleoperation scale at which the tip moves as recorded.
    scale: float
    # Least and greatest scale that a campaign varies it to.
    scales: tuple[float, float] | None = None
    arms: tuple[ArmSummary, ...]
    notices: tuple[str, ...] = ()  # what the robot does not follow


def table_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    """Return (name, description) rows for terminal and report, from the file to the motion."""
    return [row for row in _rendered_rows(summary) if row[0] != "change"]


def describe_changes(summary: MotionSummary) -> list[str]:
    """Return a phrase for each change of the motion beyond its timing.

    Returns nothing if the tip moves as recorded.
    """
    return [text for what, text in _rendered_rows(summary) if what == "change"]


def _rendered_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    return resources.render_rows(Path(__file__).with_suffix(".j2"), s=summary)


@dataclasses.dataclass(frozen=True, eq=False)
class TipCourse:
    """The course of one arm. Times are seconds in the recording, positions m in frame 0."""

    arm: str
    recorded_s: np.ndarray  # [T]
    recorded: np.ndarray  # [T, 3] every sample of the file
    # Position in the recording at each millisecond of the campaign, [ticks].
    replayed_s: np.ndarray
    # [ticks, 3]; no ticks if nothing can be replayed.
    replayed: np.ndarray
    outside: tuple[tuple[float, float], ...]  # stretches that the arm cannot reach
    gaps: tuple[tuple[float, float], ...]  # stretches without samples
    spikes: tuple[float, ...]


def list_names(names: Iterable[Any], most: int = 12) -> str:
    """Return the first `most` names, and how many more there are."""
    words = [*map(str, names)]
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def format_spans(spans: Sequence[tuple[float, float]]) -> str:
    """Return spans as text: `[1.200, 3.450], .. s`, as `window_s` takes them."""
    words = list_names((f"[{begin:.3f}, {end:.3f}]" for begin, end in spans), 4)
    return f"{words} s" if spans else "none"
