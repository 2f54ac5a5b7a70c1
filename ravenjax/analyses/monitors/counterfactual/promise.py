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
    """Return the numbers of at most `most` candidates by greedy selection.

    `covered`: bool [runs, candidates]. Of candidates with equal gain the earlier is taken. A
    candidate is not taken if it adds nothing, or less than the share `least` of all runs.

    Each step takes the candidate that covers most of the runs that are still uncovered. Coverage is
    submodular, so a greedy set of k covers at least 1 - 1/e of the best set of k (Nemhauser,
    Wolsey, Fisher, Math. Program. 14, 1978). At the end, candidates that the others make
    superfluous are removed.
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
"""Share of the faults that a candidate must add to be taken into the set."""
RANDOM_SETS = 200


class Margin(NamedTuple):
    """The factor on its scales above which a set raises an alarm."""

    place: int  # index into MARGINS
    alarms: int  # runs of the calibration with an alarm
    # (alarms + one motion's runs) per hour. It is at most the target rate, or else the least
    # possible.
    bound: float

    @property
    def value(self) -> float:
        """Return the factor on the scales."""
        return MARGINS[self.place]


class Promise(NamedTuple):
    """The promise of one set of candidates."""

    members: tuple[int, ...]
    margin: Margin
    false_alarms: AlarmRate  # stated rate
    selected: Rate  # share of the selection half's faults that it covers
    covered: Rate  # share of the statement half's faults that it covers
    lead_ms: float  # median lead of the first alarm over covered faults; NaN: none


class Grounds(NamedTuple):
    """The data from which promises are computed."""

    question: Question
    calibration: FreeMotion
    statement: FreeMotion
    hazards: Hazards
    selection_half: np.ndarray  # bool [runs]
    statement_half: np.ndarray

    def promise(self, members: Sequence[int]) -> Promise:
        """Return the promise of a set."""
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
        """Return the margin that a set needs."""
        return calibrate_margin(
            join_scores(self.calibration, members), self.question.false_alarms_per_hour
        )

    def leads(self, members: Sequence[int], place: int) -> np.ndarray:
        """Return harm minus the set's first alarm at a margin, ms [runs]."""
        return self.hazards.lead_ms[:, list(members), place].max(axis=1)

    def covered(self, members: Sequence[int]) -> np.ndarray:
        """Return which faults a set detects in time at the margin that it needs, bool [runs]."""
        return self.leads(members, self.margin(members).place) >= self.question.lead_ms

    def selected(self, without: str | None = None) -> list[int]:
        """Return the greedy set of the selection half's faults, optionally without one group."""
        rows = (
            self.selection_half
            if without is None
            else self.selection_half & (self.hazards.group != without)
        )
        covered = self.hazards.lead_ms[rows, :, PROPOSED] >= self.question.lead_ms
        return select_greedily(covered, self.question.most, least=LEAST_GAIN)

    def of_strangers(self) -> Rate | None:
        """Return the share of the statement half that is detected by sets selected without the
        fault's own group.

        The interval is over groups. Return None if there is only one group.
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
        """Return the share of the statement half that each of RANDOM_SETS random sets covers."""
        rng = np.random.default_rng([self.question.seed, 2])
        among = self.hazards.lead_ms.shape[1]
        sets = [rng.choice(among, size, replace=False) for _ in range(RANDOM_SETS)]
        return np.array([self.covered(one.tolist())[self.statement_half].mean() for one in sets])


def join_scores(motions: FreeMotion, members: Sequence[int]) -> FreeMotion:
    """Return the same motions with one score, the largest of a set: peaks [motions, runs]."""
    return motions._replace(peaks=motions.peaks[:, :, list(members)].max(axis=2))


def calibrate_margin(motions: FreeMotion, per_hour: float) -> Margin:
    """Return the least margin whose expected rate is at most `per_hour`, or else the least margin
    with the least rate.

    For n motions of r runs with k alarms in total, the margin is the least with (k + r) / (n + 1)
    at most the target per motion. If motions are exchangeable, one more motion then has at most
    that many alarms on average over calibrations, for any distribution of scores. This does not
    bound the margin that one calibration took. If no margin keeps the rate, the number is only an
    estimate.
    """
    motions_there, runs = motions.peaks.shape
    hours = float(motions.hours.sum(axis=1).mean())
    alarms = [int((motions.peaks > np.float32(margin)).sum()) for margin in MARGINS]
    bounds = [(k + runs) / (motions_there + 1) / hours for k in alarms]
    limit = max(per_hour, min(bounds))
    place = next(place for place, bound in enumerate(bounds) if bound <= limit * (1 + 1e-12))
    return Margin(place, alarms[place], bounds[place])


def false_alarm_rate(motions: FreeMotion, margin: float) -> AlarmRate:
    """Return false alarms at a margin with the exact interval of a Poisson rate. A run counts once.

    If a motion has several runs, the sampled units are motions. The upper end then uses motions
    with an alarm, in the hours of one run each. The lower end uses the number of motions that the
    runs with an alarm would fill.
    """
    runs = motions.peaks.shape[1]
    over = motions.peaks > np.float32(margin)
    count, hours = int(over.sum()), float(motions.hours.sum())
    if runs == 1:
        return alarm_rate(count, hours)
    high = alarm_rate(int(over.any(axis=1).sum()), hours / runs).high
    low = alarm_rate(count // runs, hours / runs).low
    return AlarmRate(count, hours, count / hours, low, high)
