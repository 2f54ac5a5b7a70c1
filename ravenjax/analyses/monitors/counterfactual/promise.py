"""Selects a set of candidate checks and estimates its coverage and its false-alarm rate.

The set raises an alarm if the score of a candidate exceeds the candidate's scale times the set's
margin. The margin is the smallest of `MARGINS` whose expected false-alarm rate in a new motion is
at most the target. The method is conformal risk control (Angelopoulos, Bates, Fisch, Lei, Schuster,
2022) on motions that were not used to choose scales or candidates. The reported numbers come from
motions with no other use, and from faults that were not used for the selection.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.monitors.counterfactual.candidates import MARGINS, PROPOSED, Question
from ravenjax.analyses.monitors.counterfactual.observation import FreeMotion, Hazards
from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Rate


def select_greedily(covered: np.ndarray, most: int, least: float = 0.0) -> list[int]:
    """Select at most `most` candidates greedily and return their numbers.

    `covered`: bool [runs, candidates]. Each step selects the candidate that covers most of the runs
    that are still uncovered, or the first of several. Selection ends when a candidate would add
    less than the share `least` of all runs.

    Coverage is submodular, so a greedy set of k covers at least 1 - 1/e of the best set of k
    (Nemhauser, Wolsey, Fisher, Math. Program. 14, 1978). At the end, candidates are removed if the
    others cover all of their runs.
    """
    runs, candidates = covered.shape
    left, picks = np.ones(runs, bool), []
    while len(picks) < min(most, candidates):
        gain = covered[left].sum(axis=0)
        best = int(np.argmax(gain))
        if not gain[best] or gain[best] < least * runs:
            break
        picks.append(best)
        left &= ~covered[:, best]
    rest = list(picks)
    for pick in reversed(picks):
        others = [other for other in rest if other != pick]
        if others and not (covered[:, pick] & ~covered[:, others].any(axis=1)).any():
            rest = others
    return rest


LEAST_GAIN = 0.01
"""Share of the faults that a candidate must add to be selected."""
RANDOM_SETS = 200


class Margin(NamedTuple):
    """The factor on the scales above which a set of candidates raises an alarm."""

    place: int  # index into MARGINS
    alarms: int  # number of fault-free runs with an alarm
    # Expected alarms per hour in a new motion, from `calibrate_margin`. It is at most the target
    # rate, or else the smallest possible rate.
    bound: float

    @property
    def value(self) -> float:
        """Return the factor on the scales."""
        return MARGINS[self.place]


class Promise(NamedTuple):
    """Margin, false alarms and coverage of one set of candidates."""

    members: tuple[int, ...]
    margin: Margin
    false_alarms: AlarmRate  # in motions with no other use
    selected: Rate  # share of the faults for the selection that the set detects in time
    covered: Rate  # share of the faults for the statement that the set detects in time
    lead_ms: float  # median lead time of the first alarm over covered faults; NaN if none


class Grounds(NamedTuple):
    """Fault-free motions and evading faults, from which coverage and false alarms are computed."""

    question: Question
    calibration: FreeMotion  # motions that determine margins
    statement: FreeMotion  # motions that measure false alarms
    hazards: Hazards
    selection_half: np.ndarray  # bool [runs], faults with which a set is selected
    statement_half: np.ndarray  # bool [runs], faults with which its coverage is measured

    def promise(self, members: Sequence[int]) -> Promise:
        """Return margin, false alarms and coverage of a set of candidates."""
        margin = self.margin(members)
        lead = self.leads(members, margin.place)
        hit = lead >= self.question.lead_ms
        among = hit & self.statement_half
        return Promise(
            tuple(members),
            margin,
            false_alarm_rate(join_scores(self.statement, members), margin.value),
            self.hazards.rate(hit, self.selection_half),
            self.hazards.rate(hit, self.statement_half),
            float(np.median(lead[among])) if among.any() else float("nan"),
        )

    def margin(self, members: Sequence[int]) -> Margin:
        """Return the smallest margin with which a set keeps the target rate of false alarms."""
        return calibrate_margin(
            join_scores(self.calibration, members), self.question.false_alarms_per_hour
        )

    def leads(self, members: Sequence[int], place: int) -> np.ndarray:
        """Return the time from the first alarm of a set to the harm, ms [runs].

        place: index of the margin in MARGINS.
        """
        return self.hazards.lead_ms[:, list(members), place].max(axis=1)

    def covered(self, members: Sequence[int]) -> np.ndarray:
        """Return which faults a set detects in time with its margin, bool [runs]."""
        return self.leads(members, self.margin(members).place) >= self.question.lead_ms

    def selected(self, without: str | None = None) -> list[int]:
        """Select a set greedily with the faults for selection, optionally without one group."""
        rows = (
            self.selection_half
            if without is None
            else self.selection_half & (self.hazards.group != without)
        )
        covered = self.hazards.lead_ms[rows, :, PROPOSED] >= self.question.lead_ms
        return select_greedily(covered, self.question.most, least=LEAST_GAIN)

    def of_strangers(self) -> Rate | None:
        """Return the share of the faults that are detected by a set that was selected without the
        group of the fault.

        It estimates coverage for unknown kinds of faults. The interval is over groups. The result
        is None if there is only one group.
        """
        group, hit = self.hazards.group, np.zeros(self.hazards.count, bool)
        names = np.unique(group[self.statement_half])
        if len(np.unique(group)) < 2:
            return None
        for name in names:
            if members := self.selected(without=str(name)):
                hit |= (group == name) & self.covered(members)
        return units.rate_band(
            hit[self.statement_half], units.group_units(group[self.statement_half])
        )

    def at_random(self, size: int) -> np.ndarray:
        """Return the share of the faults that each of RANDOM_SETS random sets covers."""
        rng = np.random.default_rng([self.question.seed, 2])
        among = self.hazards.lead_ms.shape[1]
        sets = [rng.choice(among, size, replace=False) for _ in range(RANDOM_SETS)]
        return np.array([self.covered(one.tolist())[self.statement_half].mean() for one in sets])


def join_scores(motions: FreeMotion, members: Sequence[int]) -> FreeMotion:
    """Return the motions with the largest score of a set of candidates: peaks [motions, runs]."""
    return motions._replace(peaks=motions.peaks[:, :, list(members)].max(axis=2))


def calibrate_margin(motions: FreeMotion, per_hour: float) -> Margin:
    """Return the smallest margin whose expected rate of false alarms is at most `per_hour`.

    For n motions of r runs with k alarms in total, the margin is the smallest for which
    (k + r) / (n + 1) is at most the target per motion. If motions are exchangeable, one more motion
    then has at most that many alarms on average over calibrations, for any distribution of scores.
    The rate with the margin of one calibration may be higher. If no margin keeps the target, the
    result is the smallest margin with the lowest rate. This rate is then an estimate, not a bound.
    """
    motion_count, runs = motions.peaks.shape
    hours = float(motions.hours.sum(axis=1).mean())
    alarms = [int((motions.peaks > np.float32(margin)).sum()) for margin in MARGINS]
    bounds = [(k + runs) / (motion_count + 1) / hours for k in alarms]
    limit = max(per_hour, min(bounds))
    index = next(index for index, bound in enumerate(bounds) if bound <= limit * (1 + 1e-12))
    return Margin(index, alarms[index], bounds[index])


def false_alarm_rate(motions: FreeMotion, margin: float) -> AlarmRate:
    """Return the rate of false alarms at a margin, with the exact interval of a Poisson rate.

    A run counts at most one alarm. If a motion has several runs, the independent units are motions.
    The upper end then counts motions with an alarm, in the hours of one run per motion. The lower
    end counts the motions that the runs with an alarm would fill.
    """
    runs = motions.peaks.shape[1]
    over = motions.peaks > np.float32(margin)
    count, hours = int(over.sum()), float(motions.hours.sum())
    if runs == 1:
        return alarm_rate(count, hours)
    high = alarm_rate(int(over.any(axis=1).sum()), hours / runs).high
    low = alarm_rate(count // runs, hours / runs).low
    return AlarmRate(count, hours, count / hours, low, high)
