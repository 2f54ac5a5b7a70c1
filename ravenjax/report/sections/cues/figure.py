"""Chart of the cue sweep: what each haptic set misses over what it disturbs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.document.chart import EMPTY, Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.document.palette import CUE, SAME
from ravenjax.document.ticks import above
from ravenjax.report import wording
from ravenjax.report.sections.cues.sweep import CueRow
from ravenjax.stats.alarms.false_alarms import AlarmRate


def tradeoff(rows: Sequence[CueRow]) -> Chart | None:
    """Missed hazards over false cues an hour, one mark a set, those that none beats joined; None
    without either.
    """
    able = [row for row in rows if row.missed.n and row.per_hour is not None]
    if not able:
        return None
    best = sorted(
        (row for row in able if row.best), key=lambda row: (_hourly(row).per_hour, row.missed.value)
    )
    front_x, front_y = (
        np.array([[_hourly(row).per_hour, row.missed.value] for row in best]).reshape(-1, 2).T
    )
    marks: list[Mark] = [
        Curve("front", CUE, front_x, front_y, step=True, dashed=True, in_legend=False)
    ]
    for is_best, name, colour in (
        (False, "beaten by another", SAME),
        (True, "no other does better", CUE),
    ):
        mine = [row for row in able if row.best == is_best]
        if mine:
            marks.append(_marks(mine, name, colour))
    most = (
        max(_hourly(row).per_hour for row in able) or max(_hourly(row).high for row in able) or 1.0
    )
    missed = max(float(np.fmax(row.missed.value, row.missed.high)) for row in able) or 0.01
    return Chart(
        "Missed hazards, false cues",
        ChartAxis("false cues per hour of fault-free motion", 0.0, above(1.1 * most)),
        ChartAxis(
            "unintended motions without a cue", 0.0, min(1.0, above(1.02 * missed)), share=True
        ),
        tuple(marks),
    )


def _hourly(row: CueRow) -> AlarmRate:
    assert row.per_hour is not None
    return row.per_hour


def _marks(rows: Sequence[CueRow], name: str, colour: str) -> Dots:
    force = np.array([row.force for row in rows])
    largest = force[np.isfinite(force)].max(initial=0.0)
    sampled = np.isfinite([row.missed.low for row in rows]).all()
    scale = np.nan_to_num(force / largest) if largest > 0 else np.zeros(len(rows))
    first: dict[float, CueRow] = {}
    for row in rows:  # gains that change only the force fall on one mark: one label for them
        first.setdefault(row.cue.threshold_mm, row)
    return Dots(
        name,
        colour,
        np.array([_hourly(row).per_hour for row in rows]),
        np.array([row.missed.value for row in rows]),
        np.array([_hourly(row).low for row in rows]),
        np.array([_hourly(row).high for row in rows]),
        np.array([row.missed.low for row in rows]) if sampled else EMPTY,
        np.array([row.missed.high for row in rows]) if sampled else EMPTY,
        tuple((9 + 5 * scale).round(1).tolist()),
        tuple(
            f"{row.cue.threshold_mm:g} mm" if first[row.cue.threshold_mm] is row else ""
            for row in rows
        ),
        tuple(map(_words, rows)),
    )


def _words(row: CueRow) -> str:
    interval = (
        wording.interval(row.missed)
        or f"{wording.count(row.missed.k)} of {wording.count(row.missed.n)}"
    )
    missed = f"missed {wording.percent(row.missed.value)} ({interval})"
    hourly = f"{wording.number(_hourly(row).per_hour)} false cues an hour"
    felt = f"peak force {wording.number(row.force)}, felt for {wording.number(row.felt_ms)} ms"
    return f"{row.told}: {missed}, {hourly}, {felt}"
