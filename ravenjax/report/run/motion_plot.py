"""Draws the recorded motion of an operator, and marks the part that the campaign replays."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ravenjax import robots
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.document.palette import SAME
from ravenjax.report.drawing import save_panels
from ravenjax.report.run.plot import ARM_COLOURS
from ravenjax.store.files import require_writable
from ravenjax.store.motion.summary import TipCourse
from ravenjax.vocabulary import TICK_S

ROWS = ("x, mm", "y, mm", "z, mm", "tip speed, mm/s")
MARGIN_S = 0.1
"""Samples within this time of a replayed part are drawn with it, s."""
MAX_DOTS = 400
"""Up to this number of samples, each is drawn as a dot, so that the spacing is visible."""


def motion_plot(courses: Sequence[TipCourse], out: Path, name: str, title: str) -> list[Path]:
    """Draw `courses` into the folder `out` as NAME.svg and NAME.png and return their paths.

    The charts show the tip in frame 0 of its arm, and its speed: on the left of the recording, on
    the right of the replayed part, if there is one. Raises StoreError if `out` cannot be written.
    """
    require_writable(out)
    columns = 2 if all(len(course.replayed_s) for course in courses) else 1
    charts = [chart for course in courses for chart in _draw_course(course)]
    paths = [out / f"{name}.{kind}" for kind in ("svg", "png")]
    for path in paths:
        save_panels(path, charts, columns, title)
    return paths


def _draw_course(course: TipCourse) -> list[Chart]:
    # Returns a chart of each row of ROWS over the whole recording and, if a part is replayed, a
    # second chart over this part. A replay may return backwards; only the way forward is drawn.
    count = int(np.argmax(course.replayed_s)) + 1 if len(course.replayed_s) else 0
    replayed_s = course.replayed_s[:count]
    time_spans = [course.recorded_s]
    if count:
        time_spans.append(replayed_s)
    # Charts have the recording's time. The samples of a replay are 1 ms apart at any speed.
    recording = _position_and_speed(course.recorded_s, course.recorded)
    replay = _position_and_speed(np.arange(count) * TICK_S, course.replayed[:count])
    colour = ARM_COLOURS[robots.USUAL.arms.index(course.arm)]
    charts = []
    for row, title in enumerate(ROWS):
        for times in time_spans:
            begin, end = float(times[0]), float(times[-1])
            recorded_s = course.recorded_s
            is_near = (recorded_s >= begin - MARGIN_S) & (recorded_s <= end + MARGIN_S)
            recorded_s, recorded = recorded_s[is_near], recording[is_near, row]
            all_values = np.concatenate([recorded, replay[:, row]])
            low, high = float(np.nanmin(all_values)), float(np.nanmax(all_values))
            margin = 0.05 * (high - low) or 1.0
            low, high = low - margin, high + margin
            # Each coloured span is the band of a curve, from `floor` to `top` of the chart.
            floor, top = np.full(2, low), np.full(2, high)
            marks: list[Mark] = [Curve("recorded", SAME, recorded_s, recorded)]
            if is_near.sum() <= MAX_DOTS:
                marks.append(Dots("", SAME, recorded_s, recorded, in_legend=False))
            if count:
                marks.append(Curve(f"replayed, {course.arm}", colour, replayed_s, replay[:, row]))
            for label, tint, spans in (
                ("outside the joint limits", "cue", course.outside),
                ("gap", "series7", course.gaps),
            ):
                marks += [Curve(label, tint, np.array(span), floor, floor, top) for span in spans]
            # A jump is a vertical line over the whole height.
            height = np.array([low, high])
            jumps = (np.full(2, spike) for spike in course.spikes)
            marks += [Curve("jump", "series3", jump, height, dashed=True) for jump in jumps]
            x_axis = ChartAxis("time in the recording, s", begin, end)
            y_axis = ChartAxis("", low, high)
            charts.append(Chart(f"{course.arm} {title}", x_axis, y_axis, tuple(marks), height=100))
    return charts


def _position_and_speed(time_s: np.ndarray, position_m: np.ndarray) -> np.ndarray:
    """Return x, y, z in mm and the speed since the previous sample in mm/s, [samples, 4]."""
    speed = np.zeros(len(time_s))
    if len(time_s) > 1:
        speed[1:] = np.linalg.norm(np.diff(position_m, axis=0), axis=1) / np.diff(time_s)
        speed[0] = speed[1]
    return np.column_stack([position_m, speed]) * 1e3
