"""Detectors: which share of unintended motions they recall, how early, and how many false alarms
they give.

The robot's own checks and the haptic cue of the verdicts stand beside the campaign's detectors as
two that have a single threshold. Rates and times are of one run of each fault; curves are of every
run, or of so many drawn. Where faults were drawn, intervals are over them and bands resample them;
where their values were enumerated there are none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ravenjax.report.data import counted, leads
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.runs import UNINTENDED, Runs, after_onset, end_of
from ravenjax.report.sections import tables
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.alarms.roc import CurveBand
from ravenjax.stats.bootstrap.resample import BootstrapBand
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import Incidence, Lead
from ravenjax.store.manifest import DetectorRecord, Manifest

CHECKS, ALL_CHECKS, CUE = "built-in checks", "all checks, your own too", "haptic cue"
GRID = np.unique(np.concatenate([np.linspace(0, 0.1, 41), np.linspace(0.1, 1, 91)]))
"""Of curves: finer where alarms are few, which is where a detector would be used."""
DRAWS = 1_000_000
"""Runs drawn for the bands of one curve, all resamples together; between 100 and 400 resamples."""
MOST_DRAWN = 20_000
"""Runs that curves are made of; of more, about so many are drawn, and bands are too wide rather
than too narrow.
"""
SCORED = "plain AND faulty AND NOT failed"
MOST_THRESHOLDS = 12
"""Thresholds of a detector in the table; of more, so many, evenly taken, and the quiet one."""


class DetectorThreshold(NamedTuple):
    """What one threshold of a detector does. threshold: in the unit of the score, NaN for a
    check or a cue.
    """

    detector: str
    threshold: float
    caught: Rate  # of faults with an unintended motion, those with an alarm
    harmless: Rate  # of faults without one, those with an alarm
    precision: Rate  # of faults with an alarm, those with an unintended motion
    false: AlarmRate | None  # on fault-free motion; None: not known
    delay_ms: (
        Estimate  # median over faults with an unintended motion, from the fault's first effect
    )
    before: Rate  # of faults with an unintended motion, those with an alarm before it
    # median over faults with an unintended motion; NaN: half of them never had an alarm
    lead_ms: Estimate
    quiet: bool  # the lowest threshold without a false alarm on fault-free motion
    # whether it is a finding that it comes before the motion, and no matter of definitions
    leads: bool


class ThresholdAlarms(NamedTuple):
    """When a detector first spoke at one threshold, in every run of the table; -1: never."""

    name: str
    threshold: float
    column: str  # of facts
    free: int | None  # fault-free motions in which it spoke; None: not known
    false: AlarmRate | None  # first false alarms an hour of them; None: not known
    quiet: bool
    leads: bool = True  # as of DetectorThreshold


class DetectorRow(NamedTuple):
    """One detector."""

    name: str
    what: str  # kind and settings in words
    thresholds: list[DetectorThreshold]
    roc: (
        CurveBand | None
    )  # None for a check or a cue, and where runs do not differ in it or are all of one fault
    recall: CurveBand | None
    auc: BootstrapBand | None
    average_precision: BootstrapBand | None


class Curves(NamedTuple):
    """How early one detector speaks at its quiet threshold (else its highest), over runs with an
    unintended motion.
    """

    name: str
    threshold: float
    delay: Incidence  # from the fault's first effect
    lead: Lead
    leads: bool  # as of DetectorThreshold


def alarms(runs: Runs, manifest: Manifest) -> list[ThresholdAlarms]:
    """Everything that can speak, at each threshold: the campaign's detectors, the checks, the
    cue of the verdicts.
    """
    free = runs.motions()
    result = [one for d in range(len(manifest.detectors)) for one in _thresholds(runs, manifest, d)]
    checks = CHECKS if manifest.rules.built_in == "response" else ALL_CHECKS
    result.append(ThresholdAlarms(checks, math.nan, "told_ms", None, None, False))
    if manifest.cues:
        cues = free.came(f"golden_cue{manifest.verdict_cue}_first_ms")
        name = f"{CUE}, {manifest.cues[manifest.verdict_cue].threshold_mm:g} mm"
        rate = free.cue_rate(manifest.verdict_cue)
        result.append(
            ThresholdAlarms(name, math.nan, "warned_ms", cues, rate, cues == 0, runs.cue_leads)
        )
    return result


def _thresholds(runs: Runs, manifest: Manifest, d: int) -> Iterator[ThresholdAlarms]:
    detector = manifest.detectors[d]
    free, score = runs.motions(), f"golden_detector{d}_score"
    events = [
        run_facts.beyond_sql(score, threshold, runs.types) for threshold in detector.thresholds
    ]
    counts = [free.with_event(event) for event in events]
    quiet = min(
        (
            threshold
            for threshold, count in zip(detector.thresholds, counts, strict=True)
            if not count
        ),
        default=None,
    )
    for k, (threshold, count, event) in enumerate(
        zip(detector.thresholds, counts, events, strict=True)
    ):
        rate = free.first_rate(event, f"detector{d}_threshold{k}_first_ms")
        column, early = f"alarm{d}_{k}_ms", leads.detector(manifest, detector, threshold)
        yield ThresholdAlarms(
            detector.name, threshold, column, count, rate, threshold == quiet, early
        )


def known(found: list[ThresholdAlarms]) -> str:
    """When anyone could first know of each run's fault, -1 if never, as an expression of columns of
    facts: the cue, a check, or a detector at its lowest threshold without a false alarm; what spoke
    before the fault had any effect does not know of it."""
    return _first(one for one in found if _speaks(one))


def before_motion(found: list[ThresholdAlarms]) -> str:
    """As `known`, without what cannot come before the motion by the definitions alone: cues and tip
    errors at its limit or beyond. Of what is left it is a finding whether it comes before the
    motion."""
    return _first(one for one in found if _speaks(one) and one.leads)


def _speaks(one: ThresholdAlarms) -> bool:
    """Whether one would listen to it."""
    return one.quiet or one.free is None or math.isnan(one.threshold)


def _first(found: Iterable[ThresholdAlarms]) -> str:
    return run_facts.first_sql(*(f"({after_onset(one.column)})" for one in found))


def rows(runs: Runs, manifest: Manifest, found: list[ThresholdAlarms]) -> list[DetectorRow]:
    """One row a detector, then the checks and the cue."""
    names = list(dict.fromkeys(one.name for one in found))
    thresholds_of = {name: _shown([one for one in found if one.name == name]) for name in names}
    counts = _caught(runs, [one for own in thresholds_of.values() for one in own])
    result = []
    for number, name in enumerate(names):
        thresholds = [
            _threshold(runs, manifest, one, counts[one.column]) for one in thresholds_of[name]
        ]
        scored = number < len(manifest.detectors)
        roc, recall = _bands(runs, number) if scored else (None, None)
        result.append(
            DetectorRow(
                name,
                _what(manifest.detectors[number]) if scored else "",
                thresholds,
                roc,
                recall,
                roc.area if roc else None,
                recall.area if recall else None,
            )
        )
    return result


def thresholds(
    runs: Runs, manifest: Manifest, found: list[ThresholdAlarms]
) -> list[DetectorThreshold]:
    """What each does, in their order."""
    counts = _caught(runs, found)
    return [_threshold(runs, manifest, one, counts[one.column]) for one in found]


def curve_runs(runs: Runs) -> tuple[int, int]:
    """Runs that curves are made of, about, and runs that there are."""
    n = runs.count(SCORED)
    return min(n, MOST_DRAWN), n


def curves(runs: Runs, manifest: Manifest, found: list[ThresholdAlarms]) -> list[Curves]:
    """How early each detector speaks, in the order of `found`."""
    result = []
    for name in dict.fromkeys(one.name for one in found):
        own = [one for one in found if one.name == name]
        one = next((threshold for threshold in own if threshold.quiet), own[-1])
        result.append(Curves(name, one.threshold, *_times(runs, manifest, one), one.leads))
    return result


def _shown(own: list[ThresholdAlarms]) -> list[ThresholdAlarms]:
    places = (
        np.unique(np.linspace(0, len(own) - 1, MOST_THRESHOLDS).round())
        if len(own) > MOST_THRESHOLDS
        else range(len(own))
    )
    return [one for k, one in enumerate(own) if k in places or one.quiet]


def _what(detector: DetectorRecord) -> str:
    words = [detector.kind.replace("_", " ")]
    if detector.kind == "steps":
        words.append(f"fused: {detector.fusion}")
    if detector.consecutive > 1:
        words.append(f"{detector.consecutive} ms in a row")
    return ", ".join(words)


class _Caught(NamedTuple):
    """Distinct faults: those with an unintended motion and the others, and those of both with an
    alarm.
    """

    unintended: int
    others: int
    hits: int
    misses: int


def _caught(runs: Runs, found: list[ThresholdAlarms]) -> dict[str, _Caught]:
    """By column."""
    kinds = ("unintended", "NOT unintended")
    conditions = [f"{kind} AND {one.column} >= 0" for one in found for kind in kinds]
    unintended, others, *counts = runs.counts([*kinds, *conditions], where="sample AND faulty")
    pairs = zip(counts[::2], counts[1::2], strict=True)
    return {
        one.column: _Caught(unintended, others, *pair)
        for one, pair in zip(found, pairs, strict=True)
    }


def _threshold(
    runs: Runs, manifest: Manifest, one: ThresholdAlarms, counts: _Caught
) -> DetectorThreshold:
    delay, lead = _times(runs, manifest, one)
    sampled = runs.sampled()
    return DetectorThreshold(
        one.name,
        one.threshold,
        tables.of_faults(runs, counts.hits, counts.unintended),
        tables.of_faults(runs, counts.misses, counts.others),
        tables.of_faults(runs, counts.hits, counts.hits + counts.misses),
        one.false,
        tables.known(delay.quantile_interval(0.5), sampled),
        tables.known(lead.before, sampled),
        tables.known(lead.quantile(0.5), sampled),
        one.quiet,
        one.leads,
    )


def _times(runs: Runs, manifest: Manifest, one: ThresholdAlarms) -> tuple[Incidence, Lead]:
    """Delay after the first effect, and lead over the unintended motion; an alarm before the first
    effect counts as none, for it tells of something else."""
    event, end = after_onset(one.column), end_of(manifest)
    delay, lags = (
        runs.delays(event, start, end, UNINTENDED)[""] for start in ("active_ms", "unintended_ms")
    )
    return counted.incidence(delay), counted.lead(lags)


def _bands(runs: Runs, number: int) -> tuple[CurveBand, CurveBand] | tuple[None, None]:
    """Of the runs drawn; none where they do not differ in it, or are all of one fault."""
    from ravenjax.stats.alarms.roc import precision_recall_band, roc_band

    score = f"detector{number}_score"
    sample = runs.drawn(f'{score} AS score, unintended, "distinct" AS cell', SCORED, MOST_DRAWN)
    values, unintended, cell = (sample[name].to_numpy() for name in ("score", "unintended", "cell"))
    if min(len(np.unique(unintended)), len(np.unique(cell))) < 2:
        return None, None
    options: dict[str, Any] = {"resamples": int(np.clip(DRAWS // len(values), 100, 400))}
    bands = (
        roc_band(values, unintended, cell, grid=GRID, **options),
        precision_recall_band(values, unintended, cell, grid=GRID[1:], **options),
    )
    return bands if runs.sampled() else (_bare(bands[0]), _bare(bands[1]))


def _bare(band: CurveBand) -> CurveBand:
    """A curve without its band."""
    none = np.full(len(band.grid), np.nan)
    return CurveBand(
        band.grid,
        band.curve._replace(low=none, high=none),
        band.area._replace(low=np.nan, high=np.nan),
    )
