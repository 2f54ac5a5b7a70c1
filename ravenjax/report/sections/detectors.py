"""Section "Detectors": recall, delay and false alarms of each detector at each threshold.

The robot's checks and the haptic cue that the verdicts use appear as two more detectors, with one
threshold each. Rates and times use one run of each fault. Curves use every run, or a random subset.
If faults were drawn, a bootstrap over faults gives bands. Enumerated faults have none.
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.report import wording
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.runs import DISTINCT_FAULTS, Runs, after_onset
from ravenjax.report.sections import tables
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.alarms.roc import CurveBand
from ravenjax.stats.intervals import Estimate, Rate

CHECKS, ALL_CHECKS, CUE = "built-in checks", "all checks, including your own", "haptic cue"
GRID = np.unique(np.concatenate([np.linspace(0, 0.1, 41), np.linspace(0.1, 1, 91)]))
"""Abscissas of the curves, denser at low rates of alarms, because detectors are used there."""
DRAWS = 1_000_000
"""Runs drawn for the bands of one curve, over all its resamples, of which there are 100 to 400."""
MOST_DRAWN = 20_000
"""Largest number of runs for a curve. Of more runs, some are drawn, so the bands are wider."""
SCORED = "plain AND faulty AND activated AND NOT failed"
MOST_THRESHOLDS = 12
"""Thresholds in the table. Of more, this number at even spacing, and the lowest that is quiet."""
HEIGHT = 340  # px, of a chart
DRAWN = 6
"""Number of curves that are visible at first, those with the largest areas."""
CAUGHT = "share of unintended motions with an alarm"
CHARTS = {
    "roc": ("Recall and false positives", "share of other runs with an alarm", CAUGHT),
    "recall": ("Precision and recall", CAUGHT, "share of alarms with an unintended motion"),
}
"""Title and axes of each chart, by the field of `DetectorRow` with its curves."""


class DetectorThreshold(NamedTuple):
    """One threshold of a detector, in the unit of its score; NaN for a check or a cue."""

    detector: str
    threshold: float
    caught: Rate  # of faults with an unintended motion: those with an alarm
    harmless: Rate  # of faults without an unintended motion: those with an alarm
    precision: Rate  # of faults with an alarm: those with an unintended motion
    false: AlarmRate | None  # false alarms per hour of fault-free motion; None: unknown
    delay_ms: Estimate  # median over unintended motions, from the fault's first effect
    before: Rate  # of faults with an unintended motion: those with an alarm before it
    # Median over faults with an unintended motion; NaN if at least half of them never had an alarm.
    lead_ms: Estimate
    quiet: bool  # lowest threshold without a false alarm on fault-free motion


class ThresholdAlarms(NamedTuple):
    """First alarms of a detector at one threshold in every run."""

    name: str
    threshold: float
    column: str  # a column of facts
    free: int | None  # fault-free motions with an alarm; None: unknown
    false: AlarmRate | None  # first false alarms per hour of fault-free motion; None: unknown
    quiet: bool  # lowest threshold without a false alarm on fault-free motion


class DetectorRow(NamedTuple):
    """One detector."""

    name: str
    what: str  # kind and settings, in words
    thresholds: list[DetectorThreshold]
    # None for a check or a cue, and if runs do not differ in the outcome or are all of one fault.
    roc: CurveBand | None
    recall: CurveBand | None
    auc: Estimate | None


def list_alarms(runs: Runs) -> list[ThresholdAlarms]:
    """Return all sources of alarms: each threshold of each detector, the checks, and the cue."""
    manifest, motions, result = runs.manifest, runs.motions, []
    for d, detector in enumerate(manifest.detectors):
        score, levels = f"golden_detector{d}_score", detector.thresholds
        events = [run_facts.beyond_sql(score, level, runs.types) for level in levels]
        counts = [motions.count_motions(event) for event in events]
        thresholds = list(zip(levels, counts, strict=True))
        quiet = min((threshold for threshold, count in thresholds if not count), default=None)
        for k, (threshold, count) in enumerate(thresholds):
            rate = motions.first_rate(events[k], f"detector{d}_threshold{k}_first_ms")
            column, is_quiet = f"alarm{d}_{k}_ms", threshold == quiet
            result.append(ThresholdAlarms(detector.name, threshold, column, count, rate, is_quiet))
    # The false alarms of checks are unknown.
    checks = CHECKS if manifest.rules.built_in == "response" else ALL_CHECKS
    result.append(ThresholdAlarms(checks, math.nan, "told_ms", None, None, quiet=False))
    if manifest.cues:
        cues = motions.count_with_event(f"golden_cue{manifest.verdict_cue}_first_ms")
        name = f"{CUE}, {manifest.cues[manifest.verdict_cue].threshold_mm:g} mm"
        rate = motions.cue_rate(manifest.verdict_cue)
        result.append(ThresholdAlarms(name, math.nan, "warned_ms", cues, rate, quiet=cues == 0))
    return result


def knowledge_sql(runs: Runs) -> str:
    """Return SQL for the time in ms at which a run's fault was first reported, -1 if never.

    Reports come from the cue, checks, and detectors at the lowest threshold without false alarms.
    """
    # Checks have unknown false alarms (`free` is None), and the cue no threshold (NaN).
    trusted = [
        f"({after_onset(alarms.column)})"
        for alarms in runs.once(list_alarms)
        if alarms.quiet or alarms.free is None or math.isnan(alarms.threshold)
    ]
    return run_facts.first_sql(*trusted)


def detector_rows(runs: Runs) -> list[DetectorRow]:
    """Return one row per detector, then the rows of the checks and the cue."""
    measured, detectors = runs.once(list_alarms), runs.manifest.detectors
    result = []
    for number, name in enumerate(dict.fromkeys(alarms.name for alarms in measured)):
        shown = _shown([alarms for alarms in measured if alarms.name == name])
        kind, roc, recall = "", None, None
        # The names of detectors come first. Checks and the cue have no score, so no curve.
        if number < len(detectors):
            (kind,) = wording.fill_template("detector_kind.txt.j2", detector=detectors[number])
            roc, recall = _bands(runs, number)
        auc = roc.area if roc else None
        result.append(DetectorRow(name, kind, threshold_rows(runs, shown), roc, recall, auc))
    return result


def threshold_rows(runs: Runs, sources: Sequence[ThresholdAlarms]) -> list[DetectorThreshold]:
    """Return recall, precision, false alarms and times for each source of alarms, in order."""
    kinds = ("unintended", "NOT unintended")
    conditions = [f"{kind} AND {alarms.column} >= 0" for alarms in sources for kind in kinds]
    unintended, others, *counts = runs.counts([*kinds, *conditions], where=DISTINCT_FAULTS)
    # The counts alternate: faults with an alarm that have, and do not have, an unintended motion.
    result = []
    for alarms, caught, harmless in zip(sources, counts[::2], counts[1::2], strict=True):
        times = tables.event_times(runs, after_onset(alarms.column))
        row = DetectorThreshold(
            detector=alarms.name,
            threshold=alarms.threshold,
            caught=tables.fault_share(runs, caught, unintended),
            harmless=tables.fault_share(runs, harmless, others),
            precision=tables.fault_share(runs, caught, caught + harmless),
            false=alarms.false,
            delay_ms=times.half_ms,
            before=times.before,
            lead_ms=times.lead_ms,
            quiet=alarms.quiet,
        )
        result.append(row)
    return result


def curve_runs(runs: Runs) -> tuple[int, int]:
    """Return the runs that curves are made of, and the number of all runs."""
    n = runs.count(SCORED)
    return min(n, MOST_DRAWN), n


def _shown(alarms: list[ThresholdAlarms]) -> list[ThresholdAlarms]:
    # Returns the thresholds that the table lists: all, or some at even spacing and the quiet one.
    listed = np.unique(np.linspace(0, len(alarms) - 1, MOST_THRESHOLDS).round())
    few = len(alarms) <= MOST_THRESHOLDS
    return [level for k, level in enumerate(alarms) if few or k in listed or level.quiet]


def _bands(runs: Runs, number: int):
    # Returns bootstrap bands of the ROC curve and the precision-recall curve of a detector; (None,
    # None) if all runs have the same outcome, or all have the same fault.
    from ravenjax.stats.alarms.roc import curve_bands

    columns = f'detector{number}_score AS score, unintended, "distinct" AS fault'
    sample = runs.drawn(columns, SCORED, MOST_DRAWN)
    score, unintended, fault = (sample[name].to_numpy() for name in sample)
    if min(len(np.unique(unintended)), len(np.unique(fault))) < 2:
        return None, None
    resamples = int(np.clip(DRAWS // len(score), 100, 400))
    bands = curve_bands(score, unintended, fault, grid=GRID, resamples=resamples)
    # Enumerated faults have no interval.
    if runs.sampled():
        return bands
    return [CurveBand(x, *map(tables.without_interval, estimates)) for x, *estimates in bands]


def curve_chart(rows: Sequence[DetectorRow], kind: str) -> Chart | None:
    """Return the chart of this kind, see CHARTS; None if no detector has a curve.

    A dot is a threshold, a large dot the lowest one without a false alarm. Checks and the cue have
    no curve. They are diamonds.
    """
    bands = [getattr(row, kind) for row in rows]
    areas = {number: band.area.value for number, band in enumerate(bands) if band is not None}
    if not areas:
        return None
    largest = sorted(areas, key=lambda number: -areas[number])[:DRAWN]
    marks = []
    if kind == "roc":
        ends = np.array([0.0, 1.0])
        marks.append(Curve("chance", palette.SAME, ends, ends, dashed=True, in_legend=False))
    for number, row in enumerate(rows):
        colour, name, band = palette.series_colour(number), row.name, bands[number]
        # A reader can show the other curves.
        visible = number in largest or band is None
        if band is not None:
            name = f"{row.name} ({band.area.value:.3f})"
            curve, low, high = (np.asarray(part, float) for part in band.curve)
            low, high = ((), ()) if np.isnan(band.area.low) else (low, high)
            marks.append(Curve(name, colour, band.grid, curve, low, high, visible=visible))
        rates = ("harmless", "caught") if kind == "roc" else ("caught", "precision")
        # Each point is a threshold, x and y.
        points = [(one, *(getattr(one, rate).value for rate in rates)) for one in row.thresholds]
        points = [point for point in points if np.isfinite(point[1:]).all()]
        if points:
            levels, x, y = zip(*points, strict=True)
            size = tuple(11.0 if level.quiet or band is None else 7.0 for level in levels)
            scores = [level.threshold for level in levels]
            tips = tuple(row.name + ("" if np.isnan(at) else f" at {at:g}") for at in scores)
            dots = Dots(name, colour, np.array(x), np.array(y), size=size, tips=tips)
            marks.append(dataclasses.replace(dots, diamond=band is None, visible=visible))
    title, *axes = CHARTS[kind]
    x_axis, y_axis = (ChartAxis(words, 0.0, 1.0, share=True) for words in axes)
    return Chart(title, x_axis, y_axis, tuple(marks), HEIGHT)


def _content(runs: Runs, _: Path):
    if not runs.manifest.detectors:
        return None
    detectors = detector_rows(runs)
    return {
        "detectors": detectors,
        "curve_runs": curve_runs(runs),
        "roc": curve_chart(detectors, "roc"),
        "precision_recall": curve_chart(detectors, "recall"),
    }


SECTIONS = {"detectors": _content}
