"""What a recording holds and what became of it: what the manifest keeps, the terminal prints and
the report shows. summary.j2 has the words.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from ravenjax.store.motion.options import ReplayOptions


class ArmSummary(BaseModel):
    """The tip of one arm; all but `inside` is of what is replayed."""

    model_config = ConfigDict(frozen=True)

    arm: str
    orientation: str  # "recorded" or "home"
    jaws: str  # "recorded" or "home"
    inside: float  # share of the recording inside the joint limits
    extent_mm: tuple[float, float, float]  # in frame 0
    path_mm: float
    fastest_mm_s: float
    distance_mm: tuple[float, float]  # from the remote centre
    # By the low-pass: root mean square in mm, largest in mm, and when in the recording in s.
    removed: tuple[float, float, float] | None = None


class MotionSummary(BaseModel):
    """One recorded operator. Times are seconds in the recording unless they say otherwise; rows
    count from 0.
    """

    model_config = ConfigDict(frozen=True)

    file: str
    sha256: str
    options: ReplayOptions
    rows: int  # of the first arm
    clock: str  # where times come from
    read: tuple[str, ...]  # columns or topics
    ignored: tuple[str, ...]  # the others
    notes: tuple[str, ...]  # what else a reader should know
    duration_s: float
    rate_hz: float  # mean
    steps_ms: tuple[float, float, float]  # between samples: least, median, greatest
    gaps: int  # steps of more than three median ones
    longest_gap: tuple[int, float, float] | None  # row before it, begin, length in s
    spikes: tuple[str, ...]  # each in words
    outside: tuple[tuple[float, float], ...]  # stretches that cannot be replayed, the longest first
    outside_share: float  # of the recording
    window_s: tuple[float, float]  # that is replayed
    campaign_s: float  # length of the motion
    # Of the campaign: when the recording ended and hands stopped or turned; None: it did not.
    end_s: float | None
    turns: int  # how often it was played in the other direction after that
    pedal: str  # "recorded" or "down"
    pedal_down: float  # share of the campaign
    scale: float  # teleoperation scale at which the tip moves as recorded
    scales: tuple[float, float] | None = None  # least and greatest that a campaign varies it to
    arms: tuple[ArmSummary, ...]


def table_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    """(what, how it is), from the file to the motion: rows of a table for terminal and report."""
    return [row for row in _rendered_rows(summary) if row[0] != "change"]


def changes(summary: MotionSummary) -> list[str]:
    """What was done to the motion beyond its timing, a phrase each; empty where the tip moves as
    recorded.
    """
    return [text for what, text in _rendered_rows(summary) if what == "change"]


def _rendered_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    # A campaign without a recorded operator need not import it.
    import jinja2

    template = jinja2.Template(
        Path(__file__).with_name("summary.j2").read_text(encoding="utf-8"),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    lines = template.render(s=summary).splitlines()
    return [(what, text) for what, bar, text in (line.partition(" | ") for line in lines) if bar]


@dataclasses.dataclass(frozen=True, eq=False)
class TipCourse:
    """One arm. Times are seconds in the recording, positions m in frame 0."""

    arm: str
    recorded_s: np.ndarray  # [T]
    recorded: np.ndarray  # [T, 3] every sample of the file
    replayed_s: (
        np.ndarray
    )  # [ticks] where in the recording the hands are in each millisecond of the campaign
    replayed: np.ndarray  # [ticks, 3]; no ticks where nothing can be replayed
    outside: tuple[tuple[float, float], ...]  # stretches that the arm cannot reach
    gaps: tuple[tuple[float, float], ...]  # stretches without samples
    spikes: tuple[float, ...]


def listed(names: Sequence[str], most: int) -> str:
    """The first of some names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def stretches(spans: Sequence[tuple[float, float]], most: int) -> str:
    """[1.200, 3.450], .. s, as `window_s` takes them."""
    more = f" and {len(spans) - most} more" if len(spans) > most else ""
    words = ", ".join(f"[{begin:.3f}, {end:.3f}]" for begin, end in spans[:most])
    return f"{words} s{more}" if spans else "none"
