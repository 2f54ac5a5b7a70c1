"""What a recording holds and what became of it: what the manifest keeps, the terminal prints and
the report shows, with words for it.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

MOST = 8
"""Columns, spikes or stretches that are listed."""
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


# In words: rows of a table for terminal and report alike.


def table_rows(summary: MotionSummary) -> list[tuple[str, str]]:
    """(what, how it is), from the file to the motion."""
    return [
        ("file", f"{summary.file}, {_count(summary.rows)}, sha256 {summary.sha256[:12]}"),
        ("time", _time(summary)),
        ("gaps", _gaps(summary)),
        ("jumps", _spikes(summary)),
        ("low-pass", _filter(summary)),
        ("columns", _columns(summary)),
        *((f"{one.arm} joint limits", _inside(one)) for one in summary.arms),
        *([("left out", _outside(summary))] if summary.outside else []),
        ("replayed", _window(summary)),
        ("end", _end(summary)),
        ("pedal", _pedal(summary)),
        ("scale", _scale(summary)),
        *((f"{one.arm} tip", _tip(one)) for one in summary.arms),
        *(("note", note) for note in summary.notes),
    ]


def changes(summary: MotionSummary) -> list[str]:
    """What was done to the motion beyond its timing, a phrase each; empty where the tip moves as
    recorded.
    """
    phrases = []
    if summary.cutoff_hz is not None:
        removed = max((one.removed_largest_mm or 0.0 for one in summary.arms), default=0.0)
        phrases.append(f"a low-pass of {summary.cutoff_hz:g} Hz removed up to {removed:.2g} mm")
    if summary.spikes and summary.spike_treatment == "remove":
        phrases.append(
            f"{len(summary.spikes)} jump{'s were' if len(summary.spikes) > 1 else ' was'}"
            " interpolated over"
        )
    if summary.slow_down != 1.0:
        phrases.append(f"it is replayed {summary.slow_down:g} times slower")
    if summary.end_s is not None:
        phrases.append(_end(summary))
    if summary.scales is not None and set(summary.scales) != {summary.scale}:
        least, greatest = (value / summary.scale for value in summary.scales)
        phrases.append(f"the tip moves {least:.3g} to {greatest:.3g} times as far as recorded")
    if any(one.orientation == "home" for one in summary.arms):
        phrases.append("the orientation was not recorded and stays as after homing")
    return phrases


def listed(names: Sequence[str], most: int = MOST) -> str:
    """The first of some names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def stretches(spans: Sequence[tuple[float, float]], most: int = MOST) -> str:
    """[1.200, 3.450], .. s, as `window_s` takes them."""
    more = f" and {len(spans) - most} more" if len(spans) > most else ""
    return (
        ", ".join(f"[{begin:.3f}, {end:.3f}]" for begin, end in spans[:most]) + f" s{more}"
        if spans
        else "none"
    )


def _count(rows: int) -> str:
    return f"{rows:,} rows"


def _time(summary: MotionSummary) -> str:
    low, median, high = summary.steps_ms
    even = high - low < 1e-3 * median
    spread = (
        f"every {median:.4g} ms"
        if even
        else f"{low:.3g} to {high:.3g} ms apart, {median:.4g} at the median"
    )
    resampled = (
        "" if even and abs(median - 1.0) < 1e-6 else "; interpolated by time to 1,000 a second"
    )
    between = f"; {summary.rate_hz / 1000.0:.3g} rows a millisecond, those between are not used"
    return (
        f"{summary.clock}: {summary.rate_hz:.4g} rows a second ({spread}), {summary.duration_s:.3f}"
        f" s in all{resampled}{between if summary.rate_hz > 1001.0 else ''}"
    )


def _gaps(summary: MotionSummary) -> str:
    if not summary.gaps or summary.gap_s is None:
        return f"none; up to {summary.max_gap_s:g} s would be bridged (operator.max_gap_s)"
    many = f"{summary.gaps} step{'s' if summary.gaps > 1 else ''} of more than three usual ones"
    longest = (
        f"the longest {summary.gap_s:.3f} s after row {summary.gap_row}"
        f" ({summary.gap_begin_s:.3f} s)"
    )
    bridged = "bridged by interpolation" if summary.gap_s <= summary.max_gap_s else "not replayed"
    return f"{many}, {longest}: {bridged} (operator.max_gap_s = {summary.max_gap_s:g})"


def _spikes(summary: MotionSummary) -> str:
    if not summary.spikes:
        return "none of more than 1 mm at more than 0.5 m/s"
    gone = any("without coming back" in one for one in summary.spikes)
    what = {
        "remove": (
            "interpolated over"
            + (", or outside what is replayed where it does not come back" if gone else "")
        ),
        "replay": "replayed as recorded",
        "refuse": "outside what is replayed",
    }[summary.spike_treatment]
    return (
        f"{len(summary.spikes)} {what} (operator.spikes = {summary.spike_treatment!r}): "
        + listed(summary.spikes)
    )


def _filter(summary: MotionSummary) -> str:
    if summary.cutoff_hz is None:
        return (
            "none: tremor and noise are replayed as recorded (operator.cutoff_hz = 5 would remove"
            " what is faster)"
        )
    parts = [
        f"{one.removed_rms_mm:.3g} mm rms of {one.arm}, at most {one.removed_largest_mm:.3g} mm at "
        f"{one.removed_largest_s:.3f} s"
        for one in summary.arms
        if one.removed_rms_mm is not None
    ]
    return (
        f"{summary.cutoff_hz:g} Hz without phase (operator.cutoff_hz); it removed"
        f" {'; '.join(parts)}"
    )


def _columns(summary: MotionSummary) -> str:
    unread = f"; not read: {listed(summary.ignored)}" if summary.ignored else "; every one is used"
    return f"read: {listed(summary.read, 20)}{unread}"


def _inside(one: ArmSummary) -> str:
    if one.inside == 1.0:
        return "the whole recording is inside"
    return f"{min(100 * one.inside, 99.9):.1f} % of the recording is inside"


def _outside(summary: MotionSummary) -> str:
    share = (
        f"{100 * summary.outside_share:.2g} % of the recording cannot be replayed (outside a limit,"
        " gap or jump)"
    )
    return (
        f"{share}, the longest first: {stretches(summary.outside, 4)}; nothing of it is in what is"
        " replayed"
    )


def _window(summary: MotionSummary) -> str:
    begin, end = summary.window_s
    share = (end - begin) / summary.duration_s if summary.duration_s else 1.0
    why = (
        "operator.window_s"
        if summary.window_stated
        else "from the first row; operator.window_s chooses"
    )
    slow = f", {summary.slow_down:g} times slower than recorded" if summary.slow_down != 1.0 else ""
    return (
        f"{begin:.3f} to {end:.3f} s of the recording, {100 * share:.3g} % of it ({why}){slow}:"
        f" {summary.rest_s:g} s at rest, up to speed within {summary.run_up_s:g} s,"
        f" {summary.campaign_s:.3f} s in all"
    )


def _end(summary: MotionSummary) -> str:
    if summary.end_s is None:
        return "the recording does not end before the campaign"
    if summary.turns:
        often = f"{summary.turns} time{'s' if summary.turns > 1 else ''}"
        return (
            f"played in the other direction from {summary.end_s:.3f} s of the campaign on, {often}"
        )
    return f"hands rest from {summary.end_s:.3f} s of the campaign on (operator.at_end = 'hold')"


def _pedal(summary: MotionSummary) -> str:
    source = (
        "as recorded"
        if summary.pedal == "recorded"
        else "none recorded: down from 0.2 s of the campaign on"
    )
    return f"{source}; down for {100 * summary.pedal_down:.1f} % of the campaign"


def _scale(summary: MotionSummary) -> str:
    as_recorded = (
        f"the tip moves as recorded at operator.scale = {summary.scale:g}, hands"
        f" {1 / summary.scale:.4g} times as far"
    )
    if summary.scales is None or set(summary.scales) == {summary.scale}:
        return as_recorded
    least, greatest = (value / summary.scale for value in summary.scales)
    return (
        f"{as_recorded}; the campaign varies the scale: the tip moves {least:.3g} to {greatest:.3g}"
        " times as far"
    )


def _tip(one: ArmSummary) -> str:
    return "; ".join(_tip_parts(one))


def _tip_parts(one: ArmSummary) -> Iterator[str]:
    yield " x ".join(f"{value:.2f}" for value in one.extent_mm) + " mm (x, y, z)"
    yield f"path {one.path_mm:.4g} mm, at most {one.fastest_mm_s:.3g} mm/s"
    yield f"{one.distance_mm[0]:.0f} to {one.distance_mm[1]:.0f} mm from the remote centre"
    for what, source in (("orientation", one.orientation), ("jaws", one.jaws)):
        yield (
            f"{what} as recorded"
            if source == "recorded"
            else f"{what} not recorded: as after homing"
        )
