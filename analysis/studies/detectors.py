"""Study: which detector knows of a fault first, and how many false alarms does it give?

Every detector is compared with the robot's checks and the cue. Faulty runs of four motions are
pooled, and kinds of faults are resampled. An alarm of a faulty run counts from the fault's first
effect on. Thresholds are chosen by false alarms per hour on fault-free motion, and never by what
they detect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import HAZARDS
from ravenjax.report import wording
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.declaration import LAYERS
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units, label_codes
from ravenjax.stats.intervals import alpha_of
from ravenjax.store import folder, manifest
from ravenjax.store.manifest import DetectorRecord, Manifest
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.robot import OTHER_LAYER
from studies import kinds, motions_alike
from studies.motions_alike import MOTIONS, RECORDINGS, Activated
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    Variant,
    own_line,
    read_notes,
    study,
)

FREE = "free/"
"""Prefix of the names of groups without faults."""
SCALE = "param:operator.scale"
CHECKS, STOPS, CUE = "built-in checks, flag or stop", "built-in checks, stop", "haptic cue, 3 mm"
OTHERS = (CHECKS, STOPS, CUE)
"""Sources of alarms beside the detectors. Each has one threshold."""


class FaultyScores(NamedTuple):
    """Activated faulty runs, one entry per run; times in ms from the start of the run, -1:
    never.
    """

    detectors: tuple[DetectorRecord, ...]
    cell: np.ndarray  # int, equal for runs of one fault
    kind: np.ndarray  # int, equal for runs of one kind of fault (`kinds`)
    family: np.ndarray  # int, stratum of the kind
    motion: np.ndarray  # int, number of the campaign of the run
    layer: np.ndarray  # layer of the fault, in words
    active_ms: np.ndarray
    unintended_ms: np.ndarray  # when the unintended motion began
    hazard: np.ndarray  # words of `ravenjax.outcomes`
    jumped: np.ndarray  # bool, the reported tip jumped
    leapt: np.ndarray  # bool, the true tip jumped
    score: np.ndarray  # [runs, detectors]
    first_ms: tuple[np.ndarray, ...]  # of each detector [runs, thresholds]
    others_ms: Mapping[str, np.ndarray]  # for each of OTHERS
    duration_ms: int
    rules: Rules  # rules of the outcomes

    @property
    def unintended(self) -> np.ndarray:
        """Return which runs had an unintended motion."""
        return self.unintended_ms >= 0

    @property
    def faults(self) -> Units:
        """Return the kinds of faults of the runs, which are the units of intervals."""
        return units.group_units(self.kind, self.family)

    def spoke_ms(self, name: str, threshold: float) -> np.ndarray:
        """Return when a detector, or one of OTHERS (at any threshold), first gave an alarm because
        of the fault; -1: never.

        Raises KeyError and ValueError.
        """
        if name in self.others_ms:
            return self.others_ms[name]
        d = detector_names(self.detectors).index(name)
        return self.first_ms[d][:, self.detectors[d].thresholds.index(threshold)]

    def once(self) -> FaultyScores:
        """Return one run of each fault, taking the motions in turn."""
        return self.where(motions_alike.one_of_each_fault(self.cell, self.motion))

    def where(self, chosen: np.ndarray) -> FaultyScores:
        """Return the runs that `chosen` selects, a mask or indices."""
        return self._replace(
            **{name: getattr(self, name)[chosen] for name in _BY_RUN},
            first_ms=tuple(times[chosen] for times in self.first_ms),
            others_ms={name: times[chosen] for name, times in self.others_ms.items()},
        )


_BY_RUN = (
    "cell",
    "kind",
    "family",
    "motion",
    "layer",
    "active_ms",
    "unintended_ms",
    "hazard",
    "jumped",
    "leapt",
    "score",
)


class FreeScores(NamedTuple):
    """Runs without a fault, one entry per run."""

    detectors: tuple[DetectorRecord, ...]
    robot: np.ndarray  # in words: as modelled, uncertain robot ..
    recording: np.ndarray  # in words: the motion; runs of one recording resemble each other
    scale: np.ndarray
    hours: np.ndarray  # in pedal-down
    score: np.ndarray  # [runs, detectors]
    alarms: tuple[np.ndarray, ...]  # of each detector [runs, thresholds]: separate alarms
    # For each of OTHERS: 1 if a check tripped, and the pulses of the cue.
    others: Mapping[str, np.ndarray]

    def count(self, name: str, threshold: float) -> np.ndarray:
        """Return the number of separate false alarms of each run. Raises KeyError and ValueError as
        `FaultyScores.spoke_ms` does.
        """
        if name in self.others:
            return self.others[name]
        d = detector_names(self.detectors).index(name)
        return self.alarms[d][:, self.detectors[d].thresholds.index(threshold)]

    def where(self, chosen: np.ndarray) -> FreeScores:
        """Return the runs that `chosen` selects."""
        return self._replace(
            **{name: getattr(self, name)[chosen] for name in _FREE_BY_RUN},
            alarms=tuple(counts[chosen] for counts in self.alarms),
            others={name: counts[chosen] for name, counts in self.others.items()},
        )

    def per_hour(self, counts: np.ndarray) -> StudyEstimate:
        """Apply `per_hour` to these runs."""
        return per_hour(counts, self.hours, self.recording)


def per_hour(
    counts: np.ndarray, hours: np.ndarray, recording: np.ndarray, of: str = "alarms"
) -> StudyEstimate:
    """Return the rate of `counts` [runs] over `hours` [runs], with an interval by resampling
    recordings.

    There is no interval for too few recordings. For a count of zero, the interval is the exact
    Poisson one, as if the hours were independent.
    """
    total, all_hours = int(counts.sum()), float(hours.sum())
    exact = alarm_rate(total, all_hours)
    low, high = exact.low, exact.high
    if total:
        band = units.ratio_band(counts, hours, units.group_units(recording))
        low, high = float(band.low), float(band.high)
    return StudyEstimate(exact.per_hour, low, high, total, f"{of} in {all_hours:.1f} h")


_FREE_BY_RUN = ("robot", "recording", "scale", "hours", "score")


def detector_names(detectors: Sequence[DetectorRecord]) -> list[str]:
    """Return the name of each detector."""
    return [detector.name for detector in detectors]


def read_faulty(folders: Sequence[Path]) -> FaultyScores:
    """Read activated faulty runs of campaigns that differ only in their motion. Raises ValueError
    if their faults differ.
    """
    read = [(folder.read_all(path), manifest.read_manifest(path)) for path in folders]
    return pooled([frame for frame, _ in read], read[0][1])


def pooled(frames: Sequence[pd.DataFrame], made: Manifest) -> FaultyScores:
    """Pool result tables in memory, as `read_faulty` does with folders. `made`: manifest of the
    first.
    """
    return _joined([_faulty(one, made) for one in motions_alike.activated(frames, made)])


def _faulty(runs: Activated, made: Manifest) -> FaultyScores:
    frame, facts = runs.frame, runs.facts
    active = facts["active_ms"].to_numpy()

    def told(times: ArrayLike) -> np.ndarray:
        values = np.asarray(times)
        return np.where(values >= active, values, -1)

    stop = np.where(frame["response"].astype(str) == "stopped", frame["response_ms"], -1)
    return FaultyScores(
        detectors=made.detectors,
        cell=runs.cell,
        kind=runs.kind,
        family=runs.family,
        motion=np.full(len(frame), runs.motion),
        layer=facts["layer"].to_numpy(object),
        active_ms=active,
        unintended_ms=facts["unintended_ms"].to_numpy(),
        hazard=facts["hazard"].to_numpy(object),
        jumped=frame[made.verdict_jump].to_numpy(bool),
        leapt=frame["jump_tip"].to_numpy(bool),
        score=np.stack(
            [frame[f"detector{d}_score"].to_numpy(float) for d in range(len(made.detectors))],
            axis=1,
        ),
        first_ms=tuple(
            np.stack(
                [
                    told(frame[f"detector{d}_threshold{k}_first_ms"])
                    for k in range(len(one.thresholds))
                ],
                axis=1,
            )
            for d, one in enumerate(made.detectors)
        ),
        others_ms={
            CHECKS: told(facts["told_ms"]),
            STOPS: told(stop),
            CUE: told(facts["warned_ms"]),
        },
        duration_ms=made.duration_ms,
        rules=made.rules,
    )


def _joined(parts: Sequence[FaultyScores]) -> FaultyScores:
    first = parts[0]
    return first._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _BY_RUN},
        first_ms=tuple(
            np.concatenate(times) for times in zip(*(part.first_ms for part in parts), strict=True)
        ),
        others_ms={
            name: np.concatenate([part.others_ms[name] for part in parts]) for name in OTHERS
        },
    )


def read_free(folders: Sequence[tuple[str, Path]]) -> FreeScores:
    """Read fault-free runs of campaigns, each with the name of its recording. With noise, the robot
    as modelled gets another name.
    """
    parts = [
        alone(folder.read_all(path), manifest.read_manifest(path), name) for name, path in folders
    ]
    return parts[0]._replace(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _FREE_BY_RUN},
        alarms=tuple(
            np.concatenate(counts) for counts in zip(*(part.alarms for part in parts), strict=True)
        ),
        others={name: np.concatenate([part.others[name] for part in parts]) for name in OTHERS},
    )


def alone(frame: pd.DataFrame, header: Manifest, recording: str) -> FreeScores:
    """Return the fault-free runs of one result table in memory, as `read_free` does. Faulty runs
    are left out.
    """
    noise = header.config["campaign"]["noise"]
    group = frame["group"].astype(str)
    rows = group.str.startswith(FREE) & (frame["failed"] == "")
    if not noise:
        rows &= group != FREE + MORE_NOISE  # a further group as modelled
    frame = frame.loc[rows]
    robot = frame["group"].astype(str).str.removeprefix(FREE).to_numpy(object)
    if noise:
        robot = np.array([NOISY.get(word, word) for word in robot], object)
    return FreeScores(
        header.detectors,
        robot,
        np.full(len(frame), recording, object),
        frame[SCALE].to_numpy(float),
        frame["pedal_down_ms"].to_numpy(float) / 3.6e6,
        np.stack(
            [frame[f"detector{d}_score"].to_numpy(float) for d in range(len(header.detectors))],
            axis=1,
        ),
        tuple(
            np.stack(
                [
                    frame[f"detector{d}_threshold{k}_alarms"].to_numpy()
                    for k in range(len(one.thresholds))
                ],
                axis=1,
            )
            for d, one in enumerate(header.detectors)
        ),
        {
            CHECKS: _tripped(frame, "stop", "flag"),
            STOPS: _tripped(frame, "stop"),
            CUE: frame[f"cue{header.verdict_cue}_count"].to_numpy(),
        },
    )


def _tripped(frame: pd.DataFrame, *actions: checks.Action) -> np.ndarray:
    """Return 1 for each run in which a check with these actions tripped, else 0.

    A run without a fault is its own golden run, so its column `response` is always silent.
    """
    columns = [
        f"check_{name}_count"
        for name in checks.check_names(frame)
        if ROBOT.check(name).action in actions
    ]
    return (frame[columns].to_numpy() > 0).any(axis=1).astype(int)


AS_MODELLED, UNCERTAIN, NOISE, MORE_NOISE = "as modelled", "uncertain robot", "noise", "more noise"
NOISY = {AS_MODELLED: NOISE, UNCERTAIN: f"{UNCERTAIN}, {NOISE}"}
"""Names of the groups without faults in a campaign with noise."""


class Areas(NamedTuple):
    """AUC of each detector [d] and their covariance [d, d]; NaN without positives or negatives."""

    value: np.ndarray
    covariance: np.ndarray
    positives: int
    negatives: int

    def estimate(
        self, d: int, confidence: float = 0.95, of: str = "positive runs"
    ) -> StudyEstimate:
        """Return one area with its normal interval, within 0..1. `of`: what the positive
        runs are.
        """
        low, high = _interval(self.value[d], self.covariance[d, d], confidence)
        return StudyEstimate(
            float(self.value[d]), max(0.0, low), min(1.0, high), self.positives, of
        )

    def difference(
        self, d: int, than: int, confidence: float = 0.95
    ) -> tuple[StudyEstimate, float]:
        """Return area d minus area `than` of the same runs, and the two-sided p-value that they are
        equal.

        p is 1 if both are the same score.
        """
        from scipy.stats import norm

        gap = float(self.value[d] - self.value[than])
        variance = float(
            self.covariance[d, d] + self.covariance[than, than] - 2 * self.covariance[d, than]
        )
        estimate = StudyEstimate(
            gap, *_interval(gap, variance, confidence), self.positives, "positive runs"
        )
        if variance <= 1e-18:
            return estimate, 1.0 if abs(gap) < 1e-12 else 0.0
        return estimate, float(2 * norm.sf(abs(gap) / np.sqrt(variance)))


def areas(score: np.ndarray, positive: np.ndarray, kind: np.ndarray) -> Areas:
    """Return areas of score [runs, detectors] against positive (bool [runs]). `kind` [runs] is each
    run's cluster.

    Raises ValueError if lengths differ or a score is NaN.
    """
    from scipy.stats import rankdata

    score, positive = np.asarray(score, float), np.asarray(positive, bool)
    if score.ndim != 2 or score.shape[:1] != positive.shape or positive.shape != np.shape(kind):
        raise ValueError(
            f"scores {score.shape}, labels {positive.shape} and kinds {np.shape(kind)} do not fit"
        )
    if np.isnan(score).any():
        raise ValueError(f"{int(np.isnan(score).sum())} scores are NaN")
    m, n, detectors = int(positive.sum()), int((~positive).sum()), score.shape[1]
    if not m or not n:
        return Areas(np.full(detectors, np.nan), np.full((detectors, detectors), np.nan), m, n)
    rank = rankdata(score, axis=0)
    # Share of the other class that a run beats. A tie counts half.
    beats = np.empty_like(rank)
    beats[positive] = (rank[positive] - rankdata(score[positive], axis=0)) / n
    beats[~positive] = 1.0 - (rank[~positive] - rankdata(score[~positive], axis=0)) / m
    value = beats[positive].mean(axis=0)
    code, clusters = label_codes(kind)
    both = np.zeros((detectors, detectors))
    scaled = []
    for members, count in ((positive, m), (~positive, n)):
        sums = np.zeros((clusters, detectors))
        np.add.at(sums, code[members], beats[members] - value)
        units = len(np.unique(code[members]))
        both += _more(units) * (sums.T @ sums) / count**2
        scaled.append(sums / count)
    cross = scaled[0].T @ scaled[1]
    return Areas(value, both + _more(clusters) * (cross + cross.T), m, n)


def _more(units: int) -> float:
    """Return the correction for a small number of clusters."""
    return units / (units - 1) if units > 1 else np.nan


def _interval(value: float, variance: float, confidence: float) -> tuple[float, float]:
    from scipy.stats import norm

    half = norm.isf(alpha_of(confidence) / 2) * np.sqrt(max(variance, 0.0))
    return float(value - half), float(value + half)


PER_HOUR = 1.0
"""False alarms per hour that an operating point may have."""


PUBLISHED = ("steps/all/1", 1.0)
"""The published rule: each step over its 99.8 to 99.9 percentile, all three together, for one
millisecond.
"""
FORK = ("derivative_sum", 55.0)
"""The disabled second detector of raven2_sim and its threshold."""
CLIP = ("overdrive", 1.0)
"""The control software's own clip limit."""
RESAMPLES = 400
"""Number of resamples for a rate's interval."""
MOVED = "runs with unintended motion"
"""What rates are counted over."""
TIP_ERROR = "tip_error"
"""The detector whose score is the distance in mm of the reported tip from the model."""
BY_DEFINITION = StudyEstimate(math.nan, of="by definition")
"""Replaces a number that the definitions alone decide and that is no finding."""


class Chosen(NamedTuple):
    """A detector at its threshold; NaN if it has none."""

    name: str
    threshold: float

    @property
    def told(self) -> str:
        """Return it in words."""
        return (
            self.name
            if math.isnan(self.threshold)
            else f"{self.name}, threshold {self.threshold:g}"
        )


class Point(NamedTuple):
    """One detector at one threshold. Rates are fractions."""

    name: str
    threshold: float  # NaN: without a threshold
    false: StudyEstimate  # false alarms per hour
    caught: StudyEstimate  # of runs with an unintended motion: those with an alarm
    before: StudyEstimate  # of these runs: those with the alarm before the motion began


def threshold_for(free: FreeScores, name: str, per_hour: float = PER_HOUR) -> float | None:
    """Return the lowest threshold from which on a detector's false alarms do not exceed the rate;
    None if there is none.

    Raises ValueError without any hours.
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
    """Return the performance of a detector, or one of OTHERS (threshold NaN), at a threshold."""
    return Point(
        name,
        threshold,
        free.per_hour(free.count(name, threshold)),
        caught(faulty, name, threshold),
        before(faulty, name, threshold),
    )


def by_definition(faulty: FaultyScores, name: str, threshold: float) -> bool:
    """Return whether the definitions alone decide that an alarm comes with the unintended motion or
    after it.

    This holds for the distance of the tip from the model at the motion's limit or beyond (except
    for the difference between reported and true tip). It also holds for a stop, because the robot
    is then not live.
    """
    far = faulty.rules.threshold_mm if name == CUE else threshold if name == TIP_ERROR else math.nan
    return name == STOPS or far >= faulty.rules.limit_mm


def median_times(
    first_ms: np.ndarray,
    active_ms: np.ndarray,
    unintended_ms: np.ndarray,
    end_ms: float,
    faults: Units,
) -> tuple[StudyEstimate, StudyEstimate]:
    """Return medians of the delay and of the lead of `latencies`, with intervals over kinds of
    faults; one entry per fault.
    """
    came = first_ms >= 0
    spoke = np.where(came, first_ms, end_ms)
    delay = latency.delay_quantile(spoke - active_ms, came, 0.5, faults)
    value, low, high = latency.delay_quantile(spoke - unintended_ms, came, 0.5, faults)
    return _told(delay, len(came)), _told((-value, -high, -low), len(came))


def share(hit: np.ndarray, among: np.ndarray, faults: Units, of: str) -> StudyEstimate:
    """Return the rate of `hit` among `among` (bool [runs]), with its interval over kinds of faults
    (`units.rate_band`).

    `faults`: kinds of the runs. The rate is NaN if no run is among them.
    """
    mine = faults.where(among)
    rate = units.rate_band(hit[among], mine, resamples=RESAMPLES)
    return StudyEstimate(
        rate.value, rate.low, rate.high, rate.n, f"{of}, {kinds.count(mine)}" if rate.n else of
    )


def others(faulty: FaultyScores, free: FreeScores) -> list[Point]:
    """Return the performance of the robot's checks and the haptic cue."""
    return [point(faulty, free, name, np.nan) for name in OTHERS]


def caught(faulty: FaultyScores, name: str, threshold: float) -> StudyEstimate:
    """Return the share of the runs with an unintended motion that have an alarm at a threshold."""
    return share(faulty.spoke_ms(name, threshold) >= 0, faulty.unintended, faulty.faults, MOVED)


def before(faulty: FaultyScores, name: str, threshold: float) -> StudyEstimate:
    """Return the share of these runs with the alarm before the motion began."""
    if by_definition(faulty, name, threshold):
        return BY_DEFINITION
    spoke_ms = faulty.spoke_ms(name, threshold)
    early = (spoke_ms >= 0) & (spoke_ms < faulty.unintended_ms)
    return share(early, faulty.unintended, faulty.faults, MOVED)


def hundred(value: StudyEstimate) -> StudyEstimate:
    """Convert a fraction to percent."""
    return StudyEstimate(100 * value.value, 100 * value.low, 100 * value.high, value.n, value.of)


def percent(value: StudyEstimate) -> str:
    """Write 63.2 % (60.1–66.4 %) of 812."""
    if value.of == BY_DEFINITION.of:
        return wording.DASH
    if not value.n:
        return "no runs"
    ends = (
        f" ({wording.format_percent(value.low)} to {wording.format_percent(value.high)})"
        if np.isfinite(value.low)
        else ""
    )
    return f"{wording.format_percent(value.value)}{ends} of {wording.format_count(value.n)}"


def plain(value: StudyEstimate, show: Callable[[float], str] = wording.format_number) -> str:
    """Write 12 (10 to 15); a dash if unknown."""
    if not np.isfinite(value.value):
        return wording.DASH
    ends = (
        f" ({show(value.low)} to {show(value.high)})"
        if np.isfinite([value.low, value.high]).any()
        else ""
    )
    return show(value.value + 0.0) + ends  # avoids -0


def rate(value: StudyEstimate) -> str:
    """Write 0.8 (0 to 2.1); 3 alarms in 4.0 h."""
    return f"{plain(value)}; {wording.format_count(value.n)} in {value.of.rpartition(' in ')[2]}"


def _told(value: tuple[float, float, float], n: int) -> StudyEstimate:
    return StudyEstimate(*value, n, "faults with unintended motion")


CLUTCHED = "clutched"
"""Prefix of the recordings in which the pedal goes up and down."""


def layer_table(faulty: FaultyScores, chosen: Sequence[Chosen]) -> Table:
    """Return the share of unintended motion detected, by layer of the fault."""
    moved = faulty.where(faulty.unintended)
    parts = {layer: moved.where(moved.layer == layer) for layer in layers_of(moved.layer)}
    rows = []
    for layer, part in parts.items():
        shares = [
            percent(share(part.spoke_ms(*one) >= 0, part.unintended, part.faults, ""))
            for one in chosen
        ]
        rows.append(
            (layer, len(part.cell), len(np.unique(part.cell)), kinds.count(part.faults), *shares)
        )
    return Table(
        "Unintended motion caught, by layer of the fault",
        ("layer", MOVED, "of faults", "of kinds", *(one.told for one in chosen)),
        tuple(rows),
        "How many faults each layer has is a design, so that the rates of all layers together"
        f" depend on it. {kinds.NOTE}",
    )


def robot_table(faulty: FaultyScores, free: FreeScores, main: Sequence[str]) -> Table:
    """Return how an uncertain robot and noise change false alarms, and the threshold that would be
    needed.
    """
    modelled = free.where(free.robot == AS_MODELLED)
    rows = []
    for robot in dict.fromkeys(free.robot.tolist()):
        if robot == AS_MODELLED:
            continue
        mine = free.where(free.robot == robot)
        same = modelled.where(np.isin(modelled.recording, mine.recording))
        for name in main:
            threshold, needed = threshold_for(same, name), threshold_for(mine, name)
            rates = ["", ""]
            if threshold is not None:
                rates = [rate(part.per_hour(part.count(name, threshold))) for part in (same, mine)]
            shares = [
                percent(caught(faulty, name, one)) if one is not None else ""
                for one in (threshold, needed)
            ]
            rows.append((robot, name, _threshold(threshold), *rates, _threshold(needed), *shares))
        for name in (CUE, CHECKS):
            rates = [rate(part.per_hour(part.count(name, np.nan))) for part in (same, mine)]
            rows.append((robot, name, "", *rates, "", "", ""))
    return Table(
        "How much false alarms depend on knowing the robot",
        (
            "robot",
            "detector",
            "threshold chosen on the robot as modelled",
            "false alarms an hour there, as modelled",
            "and with this robot",
            "threshold that this robot needs",
            "caught at the first",
            "at the second",
        ),
        tuple(rows),
        "On the same recordings each time. Uncertain robot: friction x 0.7 to 1.4, mass x 0.8 to"
        " 1.25, cable stiffness x 0.5 to 2, motor constant x 0.9 to 1.1, drawn anew for each run."
        " Noise: the encoders' quantisation and the controller's torque step; more noise: 2 counts"
        " and 0.02 N m, assumed. Caught: unintended motion of the robot as modelled.",
    )


def condition_table(
    faulty: FaultyScores, fast: FaultyScores, modelled: FreeScores, main: Sequence[str]
) -> Table:
    """Return how the motion on which a threshold must be quiet changes the threshold, and so the
    share detected.
    """
    still_down = unclutched(modelled)
    conditions = (
        ("every motion and scale", modelled, faulty, 0.1),
        ("every motion, scale 0.1", at_scale(modelled, 0.1), faulty, 0.1),
        ("no clutching, scale 0.1", at_scale(still_down, 0.1), faulty, 0.1),
        ("every motion and scale", modelled, fast, 0.2),
        ("no clutching, scale 0.2", at_scale(still_down, 0.2), fast, 0.2),
    )
    rows = []
    for words, free, runs, scale in conditions:
        if not free.hours.sum() > 0:
            continue
        for name in main:
            threshold = threshold_for(free, name)
            cells: tuple[str | float, ...] = ("none is quiet", "", "", "", "")
            if threshold is not None:
                spoke_ms = runs.spoke_ms(name, threshold)
                cells = (
                    threshold,
                    rate(free.per_hour(free.count(name, threshold))),
                    percent(caught(runs, name, threshold)),
                    percent(share(spoke_ms >= 0, ~runs.unintended, runs.faults, "")),
                    percent(before(runs, name, threshold)),
                )
            rows.append((words, scale, name, *cells))
    return Table(
        "What a threshold must be quiet on, and what that costs",
        (
            "quiet on",
            "faults at scale",
            "detector",
            "threshold",
            "false alarms an hour",
            "recall",
            "other faults with an alarm",
            "caught before it began",
        ),
        tuple(rows),
        f"Thresholds: the lowest with at most {PER_HOUR:g} false alarm an hour on that motion."
        " Faults at 0.1 under four motions; at 0.2 while suturing.",
    )


def hazard_table(faulty: FaultyScores, main: Sequence[str]) -> Table:
    """Return how areas depend on what a detector is to detect."""
    listed = detector_names(faulty.detectors)
    calm = (faulty.hazard == "none") & ~faulty.jumped & ~faulty.leapt
    kinds = {
        **{
            f"{word}, the run's hazard": faulty.hazard == word for word in HAZARDS if word != "none"
        },
        "jump of the true tip": faulty.leapt,
        "jump of the reported tip alone": faulty.jumped & ~faulty.leapt,
    }
    rows = []
    for words, kind in kinds.items():
        rows_in = kind | calm
        auc = areas(faulty.score[rows_in], kind[rows_in], faulty.kind[rows_in])
        rows.append(
            (words, auc.positives, *(plain(auc.estimate(listed.index(name))) for name in main))
        )
    return Table(
        "AUC by kind of hazard",
        ("what a detector is to tell", "runs", *main),
        tuple(rows),
        f"Against {wording.format_count(int(calm.sum()))} faulty runs without hazard and jump"
        " each time. A"
        " run's hazard is the gravest that it has. Jumps are those of the published code's rule:"
        " with faults of encoders and estimates the reported tip jumps and the robot need not."
        " tip_error and the cue measure the distance of the reported tip from the model, of which"
        " the true one's belongs to the definition of an unintended motion and of a loss of"
        " motion, while the steps look for jumps. A robot that stops early shows less motion than"
        " one that goes on, and so scores less: areas below 0.5 are of such.",
    )


def layers_of(layer: np.ndarray) -> list[str]:
    """Return the layers among some runs [runs], in the robot's order."""
    there = set(layer.tolist())
    return [name for name in (*LAYERS.values(), OTHER_LAYER) if name in there]


def unclutched(free: FreeScores) -> FreeScores:
    """Return motion in which the pedal stays down."""
    return free.where(~np.char.startswith(free.recording.astype(str), CLUTCHED))


def at_scale(free: FreeScores, scale: float) -> FreeScores:
    """Return motion of one scale."""
    return free.where(np.isclose(free.scale, scale))


def _threshold(threshold: float | None) -> str | float:
    return "none is quiet" if threshold is None else threshold


CAMPAIGN = "detectors.toml"
FAST = "suture_fast"
NOISY_RECORDINGS = tuple((motion, 11) for motion in ("suture", "reach", "peg_transfer", "palpate"))
FREE_RUNS, FREE_RUNS_NOISY = 32, 8
"""Numbers of runs of the groups without faults, which come first: of all, and of the first two
groups.
"""
FREE_S = 120
MAIN = (PUBLISHED[0], "derivative_sum", "tip_error", "overdrive")


def compare(context: Context) -> Findings:
    """Compare all detectors over the same runs."""
    faulty = read_faulty([context.folders[name] for name in MOTIONS])
    fast = read_faulty([context.folders[FAST]])
    free = read_free(
        [
            (f"{motion} {seed}", context.folders[f"{kind}_{motion}_{seed}"])
            for kind, recordings in (("free", RECORDINGS), ("noise", NOISY_RECORDINGS))
            for motion, seed in recordings
        ]
    )
    return findings(faulty, fast, free)


def findings(faulty: FaultyScores, fast: FaultyScores, free: FreeScores) -> Findings:
    """Compare runs in memory, as `compare` does. `fast`: the faults at twice the scale."""
    modelled = free.where(free.robot == AS_MODELLED)
    auc = areas(faulty.score, faulty.unintended, faulty.kind)
    points = {name: _quiet(faulty, modelled, name) for name in detector_names(faulty.detectors)}
    best = max(
        (p for name, p in points.items() if p is not None and name.startswith("steps")),
        key=lambda p: p.caught.value,
        default=None,
    )
    main = (MAIN[0], *([best.name] if best and best.name != MAIN[0] else []), *MAIN[1:])
    quiet = [p for name in main if (p := points[name]) is not None]
    published = [point(faulty, modelled, *one) for one in (PUBLISHED, FORK, CLIP)]
    other_points = others(faulty, modelled)
    picks = [Chosen(p.name, p.threshold) for p in (*quiet, *other_points)]
    return Findings(
        lines=tuple(_lines(faulty, modelled, auc, quiet, published, other_points)),
        tables=(
            layer_table(faulty, picks),
            robot_table(faulty, free, main),
            condition_table(faulty, fast, modelled, main),
            hazard_table(faulty, main),
        ),
        notes=_notes(faulty, modelled),
    )


def _quiet(faulty: FaultyScores, modelled: FreeScores, name: str) -> Point | None:
    threshold = threshold_for(modelled, name)
    return None if threshold is None else point(faulty, modelled, name, threshold)


def _lines(
    faulty: FaultyScores,
    modelled: FreeScores,
    found: Areas,
    quiet: Sequence[Point],
    published: Sequence[Point],
    spoken: Sequence[Point],
) -> list[Line]:
    listed = detector_names(faulty.detectors)

    moved, faults = faulty.unintended, len(np.unique(faulty.cell))
    every = StudyEstimate(faults, of=f"{kinds.count(faulty.faults)}, {len(MOTIONS)} motions")
    lines = [
        own_line("faults, distinct", "", every),
        own_line(
            "faulty runs with unintended motion",
            "runs",
            StudyEstimate(int(moved.sum()), n=len(moved), of="activated runs of this design"),
        ),
        own_line(
            "motion without a fault, robot as modelled",
            "h",
            StudyEstimate(round(float(modelled.hours.sum()), 2)),
        ),
        *(
            own_line(f"AUC, {p.name}", "", found.estimate(listed.index(p.name), of=MOVED))
            for p in quiet
        ),
    ]
    for p in quiet:
        lines.append(
            own_line(
                f"{p.name}, threshold {p.threshold:g}: unintended motion caught",
                "%",
                hundred(p.caught),
            )
        )
        if not by_definition(faulty, p.name, p.threshold):
            words = f"{p.name}, threshold {p.threshold:g}: caught before it began"
            lines.append(own_line(words, "%", hundred(p.before)))
    slow = at_scale(unclutched(modelled), 0.1)
    for name in (p.name for p in quiet if slow.hours.sum() > 0):
        threshold = threshold_for(slow, name)
        if threshold is not None:
            words = (
                f"{name}, threshold {threshold:g}, quiet at scale 0.1 without clutching: unintended"
                " motion caught"
            )
            lines.append(own_line(words, "%", hundred(caught(faulty, name, threshold))))
    for p in published:
        lines.append(
            own_line(
                f"{p.name}, threshold {p.threshold:g}: unintended motion caught",
                "%",
                hundred(p.caught),
            )
        )
        lines.append(own_line(f"{p.name}, threshold {p.threshold:g}: false alarms", "1/h", p.false))
    for p in spoken:
        lines.append(own_line(f"{p.name}: unintended motion caught", "%", hundred(p.caught)))
        if not by_definition(faulty, p.name, p.threshold):
            lines.append(own_line(f"{p.name}: caught before it began", "%", hundred(p.before)))
        lines.append(own_line(f"{p.name}: false alarms", "1/h", p.false))
    return lines


def _notes(faulty: FaultyScores, modelled: FreeScores) -> tuple[str, ...]:
    hours, recordings = float(modelled.hours.sum()), len(np.unique(modelled.recording))
    return read_notes(
        "detectors",
        motion=events.event_meaning("unintended_motion", faulty.rules),
        hours=hours,
        recordings=recordings,
        unseen=alarm_rate(0, hours).high,
        per_hour=PER_HOUR,
        kinds=kinds.NOTE,
    )


def _variants() -> tuple[Variant, ...]:
    free = [
        motions_alike.fault_free(
            CAMPAIGN, motion, seed, FREE_RUNS, FREE_S, "How often is there an alarm for nothing?"
        )
        for motion, seed in RECORDINGS
    ]
    noisy = [
        Variant(
            f"noise_{motion}_{seed}",
            CAMPAIGN,
            (
                f"campaign.limit={FREE_RUNS_NOISY}",
                f"campaign.duration_s={FREE_S}",
                "campaign.noise=true",
                f"operator.motion={motion}",
                f"operator.seed={seed}",
            ),
            f"And with noise? {motion}, seed {seed}",
        )
        for motion, seed in NOISY_RECORDINGS
    ]
    return (
        *motions_alike.faulty(CAMPAIGN),
        Variant(FAST, CAMPAIGN, ("operator.scale=0.2",), "And at twice the scale?"),
        *free,
        *noisy,
    )


STUDY = study("detectors", variants=_variants(), compare=compare)
