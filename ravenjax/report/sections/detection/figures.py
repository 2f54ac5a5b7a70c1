"""Charts of detectors: recall of unintended motions, delay and lead of alarms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.document import palette
from ravenjax.document.chart import EMPTY, Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.document.steps import steps
from ravenjax.report.sections.detection.performance import Curves, DetectorRow, DetectorThreshold
from ravenjax.report.sections.time_to_know import log_time, of_incidence

HEIGHT = 340  # px
DRAWN = 6
"""Curves shown at first, the largest areas; others wait in the legend."""
OTHERS = 2
"""Built-in checks and cue, which stand beside the campaign's detectors."""
NEAR_MS = 500.0
"""About the unintended motion, what the chart of leads shows."""
CAUGHT, DISTURBED = "share of unintended motions with an alarm", "share of other runs with an alarm"
TELLING = "share of alarms with an unintended motion"


def roc(rows: Sequence[DetectorRow]) -> Chart | None:
    """Chart of recall over alarms in other runs; None where no detector has a curve."""
    return _chart("Recall and false positives", rows, "roc", DISTURBED, CAUGHT)


def precision_recall(rows: Sequence[DetectorRow]) -> Chart | None:
    """Chart of precision over recall."""
    return _chart("Precision and recall", rows, "recall", CAUGHT, TELLING)


def delays(curves: Sequence[Curves], end_ms: int) -> Chart:
    """Chart of the time from the first effect to the alarm, over unintended motions."""
    marks = [
        of_incidence(one.delay, _label(one), palette.series(number), end_ms)
        for number, one in enumerate(curves)
    ]
    return Chart(
        "How soon after the first effect", log_time(end_ms), _share(CAUGHT), _plain(marks), HEIGHT
    )


def leads(curves: Sequence[Curves]) -> Chart:
    """Chart of the time between alarm and unintended motion; left of 0 there is time to act. What
    fires at the motion's own distance from the model or beyond is left out."""
    able = [(number, one) for number, one in enumerate(curves) if one.leads]
    starts, ends = ([float(one.lead.lag.time[end]) for one in curves] for end in (0, -1))
    marks = []
    for number, one in able:
        lag = one.lead.lag
        line = steps(lag.time, lag.fraction, lag.low, lag.high, end=max(ends))
        marks.append(Curve.of(line, _label(one), palette.series(number)))
    low, high = max(-NEAR_MS, min(starts) - 10.0), min(NEAR_MS, max(ends) + 10.0)
    time = ChartAxis(
        "alarm minus unintended motion, ms", low, max(high, low + 20.0), unit="ms", line=0.0
    )
    return Chart("How long before the motion", time, _share(CAUGHT), _plain(marks), HEIGHT)


def _label(one: Curves) -> str:
    return one.name if np.isnan(one.threshold) else f"{one.name} at {one.threshold:g}"


def _plain(curves: Sequence[Curve]) -> tuple[Curve, ...]:
    """Many side by side: without bands; shown are the first ones, and the built-in checks and
    the cue, the last.
    """
    last = len(curves) - OTHERS
    return tuple(
        Curve(
            one.name,
            one.colour,
            one.x,
            one.y,
            step=True,
            visible=number < 2 * DRAWN or number >= last,
        )
        for number, one in enumerate(curves)
    )


def _share(title: str) -> ChartAxis:
    return ChartAxis(title, 0.0, 1.0, share=True)


def _chart(
    title: str, rows: Sequence[DetectorRow], kind: str, across: str, up: str
) -> Chart | None:
    numbered = [(number, row) for number, row in enumerate(rows) if getattr(row, kind) is not None]
    if not numbered:
        return None
    largest = sorted(numbered, key=lambda pair: -getattr(pair[1], kind).area.value)[:DRAWN]
    marks: list[Mark] = []
    if kind == "roc":
        ends = np.array([0.0, 1.0])
        marks.append(Curve("chance", palette.SAME, ends, ends, dashed=True, in_legend=False))
    for number, row in enumerate(rows):
        visible = (number, row) in largest or getattr(row, kind) is None
        marks += _marks(row, number, kind, visible)
    return Chart(title, _share(across), _share(up), tuple(marks), HEIGHT)


def _marks(row: DetectorRow, number: int, kind: str, visible: bool) -> list[Mark]:
    """Curve with band and marks of the thresholds; of what has a single threshold, the mark
    alone.
    """
    colour, name, marks = palette.series(number), row.name, []
    band = getattr(row, kind)
    if band is not None:
        name = f"{row.name} ({band.area.value:.3f})"
        low, high = (np.asarray(edge, float) for edge in (band.curve.low, band.curve.high))
        if np.isnan(band.area.low):
            low = high = EMPTY
        curve = np.asarray(band.curve.value, float)
        marks.append(Curve(name, colour, band.grid, curve, low, high, visible=visible))
    places = [(threshold, *_place(threshold, kind)) for threshold in row.thresholds]
    places = [place for place in places if np.isfinite(place[1:]).all()]
    if places:
        thresholds, x, y = zip(*places, strict=True)
        tips = tuple(
            row.name if np.isnan(threshold.threshold) else f"{row.name} at {threshold.threshold:g}"
            for threshold in thresholds
        )
        size = tuple(11.0 if threshold.quiet or band is None else 7.0 for threshold in thresholds)
        marks.append(
            Dots(
                name,
                colour,
                np.array(x),
                np.array(y),
                size=size,
                tips=tips,
                diamond=band is None,
                visible=visible,
            )
        )
    return marks


def _place(threshold: DetectorThreshold, kind: str) -> tuple[float, float]:
    if kind == "roc":
        return threshold.harmless.value, threshold.caught.value
    return threshold.caught.value, threshold.precision.value
