"""Detectors against harm: how well they tell it, how early, and how often they disturb when nothing is wrong.

The robot's own checks and the haptic cue of the verdicts stand beside the campaign's detectors as two that have a
single level. Rates and times are of one run of each fault; curves are of every run, their bands resample faults.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report import facts as run_facts
from ravenjax.stats.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.intervals import Estimate, Rate, wilson
from ravenjax.stats.latency import Incidence, Lead, incidence, lead_time
from ravenjax.stats.resample import Band
from ravenjax.stats.roc import CurveBand
from ravenjax.store.manifest import Detector, Manifest

CHECKS, CUE = "built-in checks", "haptic cue"
GRID = np.unique(np.concatenate([np.linspace(0, 0.1, 41), np.linspace(0.1, 1, 91)]))
"""Of curves: finer where alarms are few, which is where a detector would be used."""
DRAWS = 1_000_000
"""Runs drawn for the bands of one curve, all resamples together; between 100 and 400 resamples."""
MOST_DRAWN = 20_000
"""Runs that bands are made of; of more, so many are drawn, and the bands are too wide rather than too narrow."""
MOST_LEVELS = 12
"""Levels of a detector in the table; of more, so many, evenly taken, and the quiet one."""


class Level(NamedTuple):
    """What one level of a detector does. level: in the unit of the score, NaN for a check or a cue."""

    detector: str
    level: float
    caught: Rate  # of harmful runs, those with an alarm
    harmless: Rate  # of runs without harm, those with an alarm
    precision: Rate  # of alarms, those in harmful runs
    false: AlarmRate | None  # on fault-free motion; None: not known
    delay_ms: Estimate  # median over harmful runs, from the fault's first effect
    before: Rate  # of harmful runs, those with an alarm before the harm
    lead_ms: Estimate  # median over harmful runs; NaN: half of them never had an alarm
    quiet: bool  # the lowest level without a false alarm on fault-free motion


class Alarms(NamedTuple):
    """When a detector first spoke at one level, in every run of the table; -1: never."""

    name: str
    level: float
    first_ms: np.ndarray
    free: int | None  # fault-free motions in which it spoke; None: not known
    quiet: bool


class Row(NamedTuple):
    """One detector."""

    name: str
    what: str  # kind and settings in words
    levels: list[Level]
    roc: CurveBand | None  # None for a check or a cue, and where runs do not differ in harm or are all of one fault
    recall: CurveBand | None
    auc: Band | None
    average_precision: Band | None


class Curves(NamedTuple):
    """How early one detector speaks at its quiet level (else its highest), over harmful runs."""

    name: str
    level: float
    delay: Incidence  # from the fault's first effect
    lead: Lead


def alarms(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest) -> list[Alarms]:
    """Everything that can speak, level by level: the campaign's detectors, the checks, the cue of the verdicts."""
    free = run_facts.motions(frame, facts)
    found = [one for d, detector in enumerate(manifest.detectors) for one in _levels(frame, free, d, detector)]
    found.append(Alarms(CHECKS, np.nan, facts["response_ms"].to_numpy(), None, False))
    if manifest.cues:
        told = int(run_facts.first_came(free, f"twin_cue{manifest.verdict_cue}_first_ms").sum())
        name = f"{CUE}, {manifest.cues[manifest.verdict_cue].threshold_mm:g} mm"
        found.append(Alarms(name, np.nan, facts["warned_ms"].to_numpy(), told, told == 0))
    return found


def _levels(frame: pd.DataFrame, free: pd.DataFrame, d: int, detector: Detector) -> Iterator[Alarms]:
    score = free[f"twin_detector{d}_score"].to_numpy()
    false = [int((score > level).sum()) for level in detector.levels]
    quiet = min((level for level, count in zip(detector.levels, false, strict=True) if not count), default=None)
    for k, (level, count) in enumerate(zip(detector.levels, false, strict=True)):
        first = frame[f"detector{d}_level{k}_first_ms"].to_numpy()
        yield Alarms(detector.name, level, first, count, level == quiet)


def known_ms(facts: pd.DataFrame, found: list[Alarms]) -> np.ndarray:
    """When anyone could first know of each run's fault, -1 if never: the cue, a check, or a detector at its lowest
    level without a false alarm; what spoke before the fault had any effect does not know of it."""
    able = [one for one in found if one.quiet or one.free is None or np.isnan(one.level)]
    active = facts["active_ms"].to_numpy()
    return run_facts.first_of(*(np.where(one.first_ms >= active, one.first_ms, -1) for one in able))


def rows(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest, found: list[Alarms]) -> list[Row]:
    """One row a detector, then the checks and the cue."""
    hours = run_facts.hours(run_facts.motions(frame, facts))
    names = list(dict.fromkeys(one.name for one in found))
    chosen = facts["plain"] & ~facts["failed"]
    made = []
    for number, name in enumerate(names):
        levels = [_level(facts, manifest, one, hours) for one in _shown([one for one in found if one.name == name])]
        scored = number < len(manifest.detectors)
        roc = recall = None
        if scored and (facts.loc[chosen, ["harm", "distinct"]].nunique() > 1).all():
            roc, recall = _bands(frame.loc[chosen, f"detector{number}_score"], facts.loc[chosen])
        made.append(
            Row(
                name,
                _what(manifest.detectors[number]) if scored else "",
                levels,
                roc,
                recall,
                roc.area if roc else None,
                recall.area if recall else None,
            )
        )
    return made


def curves(facts: pd.DataFrame, manifest: Manifest, found: list[Alarms]) -> list[Curves]:
    """How early each detector speaks, in the order of `found`."""
    made = []
    for name in dict.fromkeys(one.name for one in found):
        own = [one for one in found if one.name == name]
        one = next((level for level in own if level.quiet), own[-1])
        made.append(Curves(name, one.level, *_times(facts, manifest, one)))
    return made


def _shown(own: list[Alarms]) -> list[Alarms]:
    kept = np.unique(np.linspace(0, len(own) - 1, MOST_LEVELS).round()) if len(own) > MOST_LEVELS else range(len(own))
    return [one for k, one in enumerate(own) if k in kept or one.quiet]


def _what(detector: Detector) -> str:
    words = [detector.kind.replace("_", " ")]
    if detector.kind == "steps":
        words.append(f"fused: {detector.fusion}")
    if detector.consecutive > 1:
        words.append(f"{detector.consecutive} ms in a row")
    return ", ".join(words)


def _level(facts: pd.DataFrame, manifest: Manifest, one: Alarms, hours: float) -> Level:
    sample = facts["sample"].to_numpy()
    harm, spoke = facts["harm"].to_numpy(), one.first_ms >= 0
    hits, misses = int((sample & harm & spoke).sum()), int((sample & ~harm & spoke).sum())
    delay, lead = _times(facts, manifest, one)
    return Level(
        one.name,
        one.level,
        wilson(hits, int((sample & harm).sum())),
        wilson(misses, int((sample & ~harm).sum())),
        wilson(hits, hits + misses),
        None if one.free is None else alarm_rate(one.free, hours) if hours else None,
        delay.quantile_interval(0.5),
        lead.before,
        lead.quantile(0.5),
        one.quiet,
    )


def _times(facts: pd.DataFrame, manifest: Manifest, one: Alarms) -> tuple[Incidence, Lead]:
    """Delay after the first effect, and lead over the harm, of harmful runs; an alarm before the first effect counts
    as none, for it tells of something else."""
    chosen = (facts["sample"] & facts["harm"] & facts["faulty"] & facts["activated"]).to_numpy()
    active, harm = facts.loc[chosen, "active_ms"].to_numpy(float), facts.loc[chosen, "harm_ms"].to_numpy(float)
    alarm = one.first_ms[chosen].astype(float)
    alarm[(alarm < 0) | (alarm < active)] = np.nan
    came = ~np.isnan(alarm)
    delay = incidence(np.where(came, alarm, manifest.duration_ms) - active, came)
    return delay, lead_time(alarm, harm, float(manifest.duration_ms))


def _bands(score: pd.Series, facts: pd.DataFrame) -> tuple[CurveBand, CurveBand]:
    from ravenjax.stats.roc import precision_recall_band, roc_band

    values, harm, cell = score.to_numpy(float), facts["harm"].to_numpy(), facts["distinct"].to_numpy()
    if len(values) > MOST_DRAWN:
        drawn = np.random.default_rng(0).choice(len(values), MOST_DRAWN, replace=False)
        values, harm, cell = values[drawn], harm[drawn], cell[drawn]
    given: dict[str, Any] = {"resamples": int(np.clip(DRAWS // len(values), 100, 400))}
    return (
        roc_band(values, harm, cell, grid=GRID, **given),
        precision_recall_band(values, harm, cell, grid=GRID[1:], **given),
    )
