"""Summarises a recording and the motion made from it, for manifest, terminal and report.

The texts are in summary.j2.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from ravenjax import resources
from ravenjax.store.motion.options import ReplayOptions


class ArmSummary(BaseModel):
    """Summary of one arm's tip motion. All fields except `inside` describe the replayed part."""

    model_config = ConfigDict(frozen=True)

    arm: str
    orientation: str  # "recorded", or "home": constantly that after homing
    jaws: str  # "recorded", or "home": constantly as after homing
    inside: float  # share of the recording inside the joint limits
    extent_mm: tuple[float, float, float]  # size of the motion along the axes of frame 0
    path_mm: float  # length of the tip's path
    fastest_mm_s: float  # largest speed
    distance_mm: tuple[float, float]  # least and greatest distance from the remote centre
    start_mm: tuple[float, float, float]  # first position in frame 0
    from_home_mm: float  # distance of the first position from that after homing
    # Removed by the low-pass filter: root mean square (mm), largest value (mm), and its time (s).
    removed: tuple[float, float, float] | None = None


class MotionSummary(BaseModel):
    """Summary of a recorded operator motion and of its replay. Times are seconds since the
    recording's begin unless stated otherwise. Rows count from 0.
    """

    model_config = ConfigDict(frozen=True)

    file: str
    sha256: str
    options: ReplayOptions
    rows: int  # number of samples of the first arm
    clock: str  # name of the column or clock that the times come from
    read: tuple[str, ...]  # columns or topics that were used
    ignored: tuple[str, ...]  # columns or topics that were not used
    notes: tuple[str, ...]  # remarks on how the file was read
    duration_s: float
    rate_hz: float  # mean sample rate
    steps_ms: tuple[float, float, float]  # least, median and greatest time between samples
    gaps: int  # number of time steps longer than three median steps
    longest_gap: tuple[int, float, float] | None  # row before the gap, begin, length in s
    spikes: tuple[str, ...]  # description of each jump of a tip
    outside: tuple[tuple[float, float], ...]  # stretches that cannot be replayed, the longest first
    outside_share: float  # share of the recording
    window_s: tuple[float, float]  # the replayed part
    campaign_s: float  # length of the motion
    # Time in the campaign when the recording ended, so the hands stopped or reversed, s.
    end_s: float | None
    turns: int  # number of reversals of the replay direction after the recording's end
    pedal: str  # "recorded", or "down": constantly down
    pedal_down: float  # share of the campaign with the pedal down
    scale: float  # teleoperation scale at which the tip moves as recorded
    # Least and greatest teleoperation scale in a campaign that varies it.
    scales: tuple[float, float] | None = None
    arms: tuple[ArmSummary, ...]
    notices: tuple[str, ...] = ()  # parts of the motion that the robot cannot follow


def table_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    """Return (name, description) rows for a table in terminal or report."""
    return [row for row in _rendered_rows(summary) if row[0] != "change"]


def describe_changes(summary: MotionSummary) -> list[str]:
    """Return a phrase for each difference, except timing, of replayed and recorded tip motion."""
    return [text for what, text in _rendered_rows(summary) if what == "change"]


def _rendered_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    return resources.render_rows(Path(__file__).with_suffix(".j2"), s=summary)


class TipCourse(NamedTuple):
    """Curves of one arm's tip. Times are seconds in the recording, positions are m in frame 0."""

    arm: str
    recorded_s: np.ndarray  # [T] times of the samples
    recorded: np.ndarray  # [T, 3] positions of all samples of the file
    # [ticks] time in the recording that is replayed in each ms of the campaign.
    replayed_s: np.ndarray
    replayed: np.ndarray  # [ticks, 3] replayed positions; empty if nothing can be replayed
    outside: tuple[tuple[float, float], ...]  # stretches that the arm cannot reach
    gaps: tuple[tuple[float, float], ...]  # stretches without samples
    spikes: tuple[float, ...]


def list_names(names: Iterable[Any], most: int = 12) -> str:
    """Return the first `most` names, and how many more there are."""
    words = [*map(str, names)]
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def format_spans(spans: Sequence[tuple[float, float]]) -> str:
    """Return time spans as text, in the form of a value of `window_s`: `[1.200, 3.450], .. s`."""
    words = list_names((f"[{begin:.3f}, {end:.3f}]" for begin, end in spans), 4)
    return f"{words} s" if spans else "none"
