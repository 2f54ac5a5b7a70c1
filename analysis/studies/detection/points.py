"""Operating points: what a detector does at one threshold, and the threshold that disturbs at most
so often.

A threshold is chosen by its rate of false alarms on motion without a fault, never by a percentile
of samples: the lowest of the campaign whose separate alarms came at most so often an hour there,
and those of each higher one, too. That is what was seen; how often they may come in truth, the
interval of the rate says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ravenjax.report import wording
from ravenjax.stats import latency
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.latency import Incidence, Lead, incidence, lead_time
from studies.detection.runs import CUE, OTHERS, STOPS, FaultyScores, FreeScores
from studies.framework import kinds
from studies.framework.study import StudyEstimate

PER_HOUR = 1.0
"""False alarms an hour that an operating point may have had."""
HORIZON_MS = 1000
"""Of the restricted mean delay; no fault begins later than so long before the end of a run."""


PUBLISHED = ("steps/all/1", 1.0)
"""The published rule: each step over its 99.8 to 99.9 percentile, all three together, one
millisecond.
"""
FORK = ("derivative_sum", 55.0)
"""The disabled second detector of raven2_sim and its threshold."""
CLIP = ("overdrive", 1.0)
"""The control software's own clip limit."""
RESAMPLES = 400
"""Of a rate's interval."""
MOVED = "runs with unintended motion"
"""What rates are of."""
TIP_ERROR = "tip_error"
"""The detector whose score is the distance in mm of the reported tip from the model."""
BY_DEFINITION = StudyEstimate(math.nan, of="by definition")
"""In place of what the definitions alone decide: no finding."""


class Chosen(NamedTuple):
    """A detector at its threshold, NaN where it has none."""

    name: str
    threshold: float

    @property
    def told(self) -> str:
        """In words."""
        return (
            self.name
            if math.isnan(self.threshold)
            else f"{self.name}, threshold {self.threshold:g}"
        )


class Point(NamedTuple):
    """One detector at one threshold. Rates are fractions, times ms."""

    name: str
    threshold: float  # NaN: has none
    false: StudyEstimate  # alarms an hour
    caught: StudyEstimate  # of runs with an unintended motion, those with an alarm
    disturbed: StudyEstimate  # of the other faulty runs, those with an alarm
    precision: StudyEstimate  # of alarms in faulty runs, those in runs with an unintended motion
    before: StudyEstimate  # of runs with an unintended motion, those with the alarm before it began
    delay_ms: StudyEstimate  # median, from the fault's first effect
    mean_delay_ms: StudyEstimate  # restricted to HORIZON_MS
    lead_ms: StudyEstimate  # median; NaN: half of them never had an alarm


def threshold_for(free: FreeScores, name: str, per_hour: float = PER_HOUR) -> float | None:
    """Lowest threshold of a detector from which on false alarms come at most so often; None if
    never.

    ValueError without any hours.
    """
    if not free.hours.sum() > 0:
        raise ValueError(f"no motion without a fault to choose a threshold of {name} on")
    thresholds = next(one.thresholds for one in free.detectors if one.name == name)
    rates = np.array(
        [free.count(name, threshold).sum() / free.hours.sum() for threshold in thresholds]
    )
    order = np.argsort(thresholds)
    quiet = np.logical_and.accumulate((rates[order] <= per_hour)[::-1])[::-1]
    return float(np.array(thresholds)[order][quiet][0]) if quiet.any() else None


def point(faulty: FaultyScores, free: FreeScores, name: str, threshold: float) -> Point:
    """What a detector, or one of OTHERS (threshold NaN), does at a threshold."""
    spoke_ms = faulty.spoke_ms(name, threshold)
    spoke, moved = spoke_ms >= 0, faulty.unintended
    delay, mean, lead = medians(faulty, name, threshold)
    return Point(
        name,
        threshold,
        free.per_hour(free.count(name, threshold)),
        share(spoke, moved, faulty.faults, MOVED),
        share(spoke, ~moved, faulty.faults, "other faulty runs"),
        share(moved, spoke, faulty.faults, "alarms"),
        before(faulty, name, threshold),
        delay,
        mean,
        BY_DEFINITION if by_definition(faulty, name, threshold) else lead,
    )


def latencies(
    first_ms: np.ndarray, active_ms: np.ndarray, unintended_ms: np.ndarray, end_ms: float
) -> tuple[Incidence, Lead]:
    """Delay of the first alarm (ms, -1: never) after the fault's first effect, and its lead over
    the unintended motion.

    One entry a fault. A run is watched to its end; one that a stop ended has no alarm any more.
    """
    came = first_ms >= 0
    lead = lead_time(np.where(came, first_ms, np.nan), unintended_ms.astype(float), end_ms)
    return incidence(np.where(came, first_ms, end_ms) - active_ms, came), lead


def by_definition(faulty: FaultyScores, name: str, threshold: float) -> bool:
    """Whether the definitions alone decide that an alarm comes with the unintended motion or after
    it.

    So the distance of the tip from the model at the motion's limit or beyond (but for what the
    reported tip differs from the true one), and a stop: the robot is not live then.
    """
    far = faulty.rules.threshold_mm if name == CUE else threshold if name == TIP_ERROR else math.nan
    return name == STOPS or far >= faulty.rules.limit_mm


def times(faulty: FaultyScores, name: str, threshold: float) -> tuple[Incidence, Lead]:
    """`latencies` of an alarm, of one run of each fault that made an unintended motion."""
    once = faulty.where(faulty.unintended).once()
    end = float(faulty.duration_ms)
    return latencies(once.spoke_ms(name, threshold), once.active_ms, once.unintended_ms, end)


def medians(
    faulty: FaultyScores, name: str, threshold: float
) -> tuple[StudyEstimate, StudyEstimate, StudyEstimate]:
    """Of the same runs with intervals over kinds of faults: median delay, its mean within
    HORIZON_MS, median lead.
    """
    once = faulty.where(faulty.unintended).once()
    first_ms, end = once.spoke_ms(name, threshold), float(faulty.duration_ms)
    delay, lead = median_times(first_ms, once.active_ms, once.unintended_ms, end, once.faults)
    came = first_ms >= 0
    waited = np.where(came, first_ms, end) - once.active_ms
    watched = float((end - once.active_ms).max(initial=1.0))
    mean = latency.mean_within(waited, came, min(float(HORIZON_MS), watched), once.faults)
    return delay, _told(mean, len(came)), lead


def median_times(
    first_ms: np.ndarray,
    active_ms: np.ndarray,
    unintended_ms: np.ndarray,
    end_ms: float,
    faults: Units,
) -> tuple[StudyEstimate, StudyEstimate]:
    """Medians of the delay and of the lead of `latencies`, intervals over kinds of faults; one
    entry a fault.
    """
    came = first_ms >= 0
    spoke = np.where(came, first_ms, end_ms)
    delay = latency.quantile(spoke - active_ms, came, 0.5, faults)
    value, low, high = latency.quantile(spoke - unintended_ms, came, 0.5, faults)
    return _told(delay, len(came)), _told((-value, -high, -low), len(came))


def share(hit: np.ndarray, among: np.ndarray, faults: Units, of: str) -> StudyEstimate:
    """Rate of `hit` among `among` (bool [runs]), its interval over kinds of faults (`units.rate`);
    faults: kinds of the runs. NaN where there are none."""
    mine = faults.where(among)
    rate = units.rate(hit[among], mine, resamples=RESAMPLES)
    return StudyEstimate(
        rate.value, rate.low, rate.high, rate.n, f"{of}, {kinds.count(mine)}" if rate.n else of
    )


def others(faulty: FaultyScores, free: FreeScores) -> list[Point]:
    """The robot's checks and the haptic cue."""
    return [point(faulty, free, name, np.nan) for name in OTHERS]


def caught(faulty: FaultyScores, name: str, threshold: float) -> StudyEstimate:
    """Share of the runs with an unintended motion that have an alarm at a threshold."""
    return share(faulty.spoke_ms(name, threshold) >= 0, faulty.unintended, faulty.faults, MOVED)


def before(faulty: FaultyScores, name: str, threshold: float) -> StudyEstimate:
    """Share of them with the alarm before the motion began."""
    if by_definition(faulty, name, threshold):
        return BY_DEFINITION
    spoke_ms = faulty.spoke_ms(name, threshold)
    early = (spoke_ms >= 0) & (spoke_ms < faulty.unintended_ms)
    return share(early, faulty.unintended, faulty.faults, MOVED)


def hundred(value: StudyEstimate) -> StudyEstimate:
    """A fraction in percent."""
    return StudyEstimate(100 * value.value, 100 * value.low, 100 * value.high, value.n, value.of)


def percent(value: StudyEstimate) -> str:
    """63.2 % (60.1–66.4 %) of 812."""
    if value.of == BY_DEFINITION.of:
        return wording.DASH
    if not value.n:
        return "no runs"
    ends = (
        f" ({wording.percent(value.low)} to {wording.percent(value.high)})"
        if np.isfinite(value.low)
        else ""
    )
    return f"{wording.percent(value.value)}{ends} of {wording.count(value.n)}"


def plain(value: StudyEstimate, show: Callable[[float], str] = wording.number) -> str:
    """12 (10 to 15); a dash for what is not known."""
    if not np.isfinite(value.value):
        return wording.DASH
    ends = (
        f" ({show(value.low)} to {show(value.high)})"
        if np.isfinite([value.low, value.high]).any()
        else ""
    )
    return show(value.value + 0.0) + ends  # no -0


def rate(value: StudyEstimate) -> str:
    """0.8 (0 to 2.1); 3 alarms in 4.0 h."""
    return f"{plain(value)}; {wording.count(value.n)} in {value.of.rpartition(' in ')[2]}"


def _told(value: tuple[float, float, float], n: int) -> StudyEstimate:
    return StudyEstimate(*value, n, "faults with unintended motion")
