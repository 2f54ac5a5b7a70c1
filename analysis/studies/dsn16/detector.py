"""The published detector: thresholds learned from fault-free steps, and the alarms that they raise
in a run.

analyze_faultfree.py and analyze_faulty.py of CSLDepend/raven2_sim: steps from one logged row to the
next of motor position, motor velocity and joint position of the first three joints. An alarm is
raised where, in one row, each of the three is over its threshold for some joint, motor velocity in
that row and the next. The code pools the steps of all runs and takes a percentile; the text speaks
of the runs' maxima.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.stats.bootstrap.resample import bootstrap
from studies.dsn16.published_log import Log
from studies.framework.study import StudyEstimate

VARIABLES = ("mpos", "mvel", "jpos")
JOINTS = ("shoulder", "elbow", "insertion")
UNITS = {"mpos": ("rad",) * 3, "mvel": ("rad/s",) * 3, "jpos": ("rad", "rad", "m")}

FIRST_PACKET = 500
"""Before it the hands rest and the arm settles."""

TAIL = 20.0
"""Steps that are kept for the bootstrap, times those above the percentile: no draw of runs
leaves so few.
"""
RESAMPLES = 1000
SEED = 2016


def steps(log: Log) -> np.ndarray:
    """|step| [rows - 1, 3 variables, 3 joints]: row i is what happens from row i of the log to the next."""  # noqa: E501
    return np.stack([np.abs(np.diff(getattr(log, name), axis=0)) for name in VARIABLES], axis=1)


class Learned(NamedTuple):
    """Steps of fault-free runs."""

    pooled: np.ndarray  # [runs, rows, 3, 3] |step|

    @property
    def maxima(self) -> np.ndarray:
        """Largest step of each run, [runs, 3, 3]."""
        return self.pooled.max(axis=1)

    def percentile(self, percent: float) -> np.ndarray:
        """Of all steps of all runs, [3, 3]: the code's threshold."""
        return np.percentile(self.pooled, percent, axis=(0, 1))

    def percentile_of_maxima(self, percent: float) -> np.ndarray:
        """Of the runs' maxima, [3, 3]: the text's threshold."""
        return np.percentile(self.maxima, percent, axis=0)


def fault_free(log: Log) -> np.ndarray:
    """Steps [rows, 3, 3] of a fault-free run once it has begun to move."""
    return steps(log)[log.packet[:-1] >= FIRST_PACKET]


def learn(runs: Iterable[np.ndarray]) -> Learned:
    """From what `fault_free` gave of runs. ValueError for none."""
    return Learned(stacked(list(runs)))


def stacked(series: Sequence[np.ndarray]) -> np.ndarray:
    """[runs, rows, ..] of a series [rows, ..] a run, each cut to the shortest: runs have more
    packets or fewer.
    """
    if not series:
        raise ValueError("thresholds are learned from at least one run, got none")
    rows = min(map(len, series))
    return np.stack([one[:rows] for one in series])


def pooled_interval(values: np.ndarray, percent: float, confidence: float = 0.95) -> StudyEstimate:
    """Percentile of `values` [runs, rows] with a block bootstrap: runs are drawn, their rows
    stay together.
    """
    runs, rows = values.shape
    flat, owner = values.ravel(), np.repeat(np.arange(runs), rows)
    beyond = (1.0 - percent / 100.0) * flat.size
    tail = np.argsort(flat)[::-1][: max(1, math.ceil(TAIL * beyond))]
    largest, owner = flat[tail], owner[tail]

    def quantile(indices: np.ndarray) -> np.ndarray:
        times = np.stack(
            [np.bincount(index, minlength=runs) for index in indices]
        )  # how often each run was drawn
        passed = np.cumsum(times[:, owner], axis=1)  # steps at least as large, of each resample
        return largest[np.minimum((passed <= beyond).sum(axis=1), len(largest) - 1)]

    band = bootstrap(runs, quantile, confidence, resamples=RESAMPLES, seed=SEED, batch=50)
    return StudyEstimate(
        float(np.percentile(flat, percent)), float(band.low), float(band.high), runs, "runs"
    )


def maxima_interval(maxima: np.ndarray, percent: float, confidence: float = 0.95) -> StudyEstimate:
    """Percentile of the runs' maxima [runs] with its order-statistic interval; an end that no
    run can give is NaN.
    """
    from scipy.stats import quantile_test

    interval = quantile_test(maxima, p=percent / 100.0).confidence_interval(confidence)
    low, high = (
        float(end) if math.isfinite(end) else math.nan for end in (interval.low, interval.high)
    )
    return StudyEstimate(float(np.percentile(maxima, percent)), low, high, len(maxima), "runs")


class RunAlarms(NamedTuple):
    """Which of a run's alarms came, inside the published window and anywhere."""

    inside: tuple[
        bool, bool, bool, bool
    ]  # motor position, motor velocity, joint position, all three in one row
    anywhere: tuple[bool, bool, bool, bool]
    first: int  # packets from t1 to the first fused alarm inside the window, -1: none


def alarms(log: Log, thresholds: np.ndarray, start: int, duration: int) -> RunAlarms:
    """Of one run with a fault in packets `start` to `start + duration - 1`; thresholds [3, 3]."""
    position, velocity, joint = np.any(
        steps(log) > thresholds, axis=2
    ).T  # each [rows - 1]: its joints are or-ed
    velocity = velocity & np.append(velocity[1:], False)
    over = np.stack([position, velocity, joint, position & velocity & joint], axis=1)
    packet = log.packet[:-1]
    window = (packet >= start) & (packet <= start + duration + 1)
    settled = packet >= FIRST_PACKET
    first = np.flatnonzero(over[:, 3] & window)
    return RunAlarms(
        inside=_four(over[window]),
        anywhere=_four(over[settled]),
        first=int(packet[first[0]] - start) if len(first) else -1,
    )


def _four(found: np.ndarray) -> tuple[bool, bool, bool, bool]:
    """Which columns of bool [rows, 4] are true anywhere."""
    return (
        bool(found[:, 0].any()),
        bool(found[:, 1].any()),
        bool(found[:, 2].any()),
        bool(found[:, 3].any()),
    )


class DetectionScore(NamedTuple):
    """A detector against the jumps of the runs it watched, in shares."""

    tpr: float  # of runs that jumped, those it told; NaN where none jumped
    fpr: float  # of runs that did not, those it told
    precision: float
    accuracy: float
    f1: float


def score(
    alarmed: Sequence[bool] | np.ndarray, jumped: Sequence[bool] | np.ndarray
) -> DetectionScore:
    """Of runs [n]. ValueError for lengths that differ."""
    alarmed, jumped = np.asarray(alarmed, bool), np.asarray(jumped, bool)
    if alarmed.shape != jumped.shape:
        raise ValueError(f"alarms {alarmed.shape} and jumps {jumped.shape} must be of one length")
    hits, false = int((alarmed & jumped).sum()), int((alarmed & ~jumped).sum())

    def share(part: float, whole: float) -> float:
        return part / whole if whole else math.nan

    return DetectionScore(
        tpr=share(hits, int(jumped.sum())),
        fpr=share(false, int((~jumped).sum())),
        precision=share(hits, hits + false),
        accuracy=share(float((alarmed == jumped).sum()), len(alarmed)),
        f1=share(2.0 * hits, hits + false + int(jumped.sum())),
    )
