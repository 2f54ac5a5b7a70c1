"""Selects a set of candidates, sets its margin, and states its coverage and false alarms.

The set alarms where any of its candidates is over its scale times the set's margin. The margin is
the least of `MARGINS` whose expected rate on one motion more is at most what is asked: conformal
risk control (Angelopoulos, Bates, Fisch, Lei, Schuster, 2022) on motions that chose neither scales
nor candidates. What is *stated* are alarms in motions that served nothing else, and faults that
selected nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.monitors.counterfactual.candidates import (
    CONFIDENCE,
    MARGINS,
    PROPOSED,
    Question,
)
from ravenjax.analyses.monitors.counterfactual.hazards import Hazards
from ravenjax.analyses.monitors.counterfactual.motions import FreeMotion
from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Rate


def greedy(
    covered: np.ndarray, most: int, weight: np.ndarray | None = None, least: float = 0.0
) -> list[int]:
    """Numbers of at most `most` candidates, those that cover most alone of the others first.

    covered: bool [runs, candidates]. weight: of each run, at least 0; None: 1. Of candidates that
    add the same the earlier is taken. Nothing is taken that adds nothing, or less than the share
    `least` of all weight.

    Each step takes the candidate that covers most of what is left. Coverage is submodular, so a
    greedy set of k covers at least 1 - 1/e of what the best k do (Nemhauser, Wolsey, Fisher, Math.
    Program. 14, 1978). Candidates that the others make superfluous are left out in the end.
    """
    runs, candidates = covered.shape
    value = np.ones(runs) if weight is None else np.asarray(weight, float)
    left = value.copy()
    picks: list[int] = []
    while len(picks) < min(most, candidates):
        gain = left @ covered
        best = int(np.argmax(gain))
        if not gain[best] > 0 or gain[best] < least * value.sum():
            break
        picks.append(best)
        left[covered[:, best]] = 0.0
    return _pruned(covered, picks, value)


def _pruned(covered: np.ndarray, picks: list[int], value: np.ndarray) -> list[int]:
    """The picks without those that the others make superfluous, the last removed first."""
    rest = list(picks)
    for one in reversed(picks):
        others = [other for other in rest if other != one]
        alone = covered[:, one] & ~covered[:, others].any(axis=1)
        if others and not value[alone].sum() > 0:
            rest = others
    return rest


LEAST_GAIN = 0.01
"""Share of the faults that a candidate must add to be taken into the set."""
RANDOM_SETS = 200


class Margin(NamedTuple):
    """How far above its scales a set alarms."""

    place: int  # of MARGINS
    alarms: int  # runs with an alarm, of the calibration's
    # (alarms + one motion's runs) an hour: what is at most the rate that is asked, or the least
    # there is
    bound: float

    @property
    def value(self) -> float:
        """Times the scales."""
        return MARGINS[self.place]


class Promise(NamedTuple):
    """One set of candidates."""

    members: tuple[int, ...]
    margin: Margin
    false_alarms: AlarmRate  # stated
    selected: Rate  # of the faults of the selection half that it covers
    covered: Rate  # of those of the statement half
    lead_ms: float  # median of the first alarm's, over those that it covers; NaN: none


class Grounds(NamedTuple):
    """What promises are made of."""

    question: Question
    calibration: FreeMotion
    statement: FreeMotion
    hazards: Hazards
    selection_half: np.ndarray  # bool [runs]
    statement_half: np.ndarray

    def promise(self, members: Sequence[int]) -> Promise:
        """What a set promises."""
        margin = self.margin(members)
        lead = self.leads(members, margin.place)
        hit = lead >= self.question.lead_ms
        among = hit & self.statement_half
        return Promise(
            tuple(members),
            margin,
            stated(joint(self.statement, members), margin.value),
            self.hazards.rate(hit, self.selection_half),
            self.hazards.rate(hit, self.statement_half),
            float(np.median(lead[among])) if among.any() else float("nan"),
        )

    def margin(self, members: Sequence[int]) -> Margin:
        """The margin that a set needs."""
        return calibrated(joint(self.calibration, members), self.question.false_alarms_per_hour)

    def leads(self, members: Sequence[int], place: int) -> np.ndarray:
        """Harm minus the set's first alarm at a margin, ms [runs]."""
        return self.hazards.lead_ms[:, list(members), place].max(axis=1)

    def covered(self, members: Sequence[int]) -> np.ndarray:
        """Which faults a set sees in time at the margin that it needs, bool [runs]."""
        return self.leads(members, self.margin(members).place) >= self.question.lead_ms

    def selected(self, without: str | None = None) -> list[int]:
        """The greedy set, of the faults of the selection half alone, or of those outside of one
        group.
        """
        rows = (
            self.selection_half
            if without is None
            else self.selection_half & (self.hazards.group != without)
        )
        covered = self.hazards.lead_ms[rows, :, PROPOSED] >= self.question.lead_ms
        return greedy(covered, self.question.most, least=LEAST_GAIN)

    def of_strangers(self) -> Rate | None:
        """Share of the statement half that sets see which were selected without the fault's own
        group, the interval over groups; None where there is one group alone."""
        group, hit = self.hazards.group, np.zeros(self.hazards.count, bool)
        names = np.unique(group[self.statement_half])
        if len(np.unique(group)) < 2:
            return None
        for name in names:
            if members := self.selected(without=str(name)):
                hit |= (group == name) & self.covered(members)
        return units.rate(hit[self.statement_half], units.units(group[self.statement_half]))

    def best_single(self) -> int:
        """The candidate that covers most of the selection half at its own margin."""
        candidates = range(self.hazards.lead_ms.shape[1])
        hits = [self.covered([one])[self.selection_half].mean() for one in candidates]
        return int(np.argmax(hits))

    def at_random(self, size: int) -> np.ndarray:
        """Share of the statement half that sets at random cover, each at its own margin:
        [RANDOM_SETS].
        """
        rng = np.random.default_rng([self.question.seed, 2])
        among = self.hazards.lead_ms.shape[1]
        sets = [rng.choice(among, size, replace=False) for _ in range(RANDOM_SETS)]
        return np.array([self.covered(one.tolist())[self.statement_half].mean() for one in sets])


def joint(motions: FreeMotion, members: Sequence[int]) -> FreeMotion:
    """The same motions with one score, the largest of a set: peaks [motions, runs]."""
    return motions._replace(peaks=motions.peaks[:, :, list(members)].max(axis=2))


def calibrated(motions: FreeMotion, per_hour: float) -> Margin:
    """The least margin whose expected rate is at most `per_hour`; where none is, the least with the
    least rate.

    Of n motions of r runs with k alarms in all, the margin is the least with (k + r) / (n + 1) at
    most what is asked of a motion. Over calibrations, one motion more then has at most that many at
    the mean, whatever the scores' distribution, if motions are exchangeable. It is no bound of the
    margin that one calibration took, and where no margin keeps the rate, an estimate.
    """
    motions_there, runs = motions.peaks.shape
    hours = float(motions.hours.sum(axis=1).mean())
    alarms = [int((motions.peaks > np.float32(margin)).sum()) for margin in MARGINS]
    bounds = [(k + runs) / (motions_there + 1) / hours for k in alarms]
    limit = max(per_hour, min(bounds))
    place = next(place for place, bound in enumerate(bounds) if bound <= limit * (1 + 1e-12))
    return Margin(place, alarms[place], bounds[place])


def stated(motions: FreeMotion, margin: float) -> AlarmRate:
    """False alarms at a margin with the exact interval of a Poisson rate; a run counts once.

    Where a motion has several runs, motions were sampled: the upper end is of motions with an
    alarm, in the hours of one run each, the lower of as many motions as the runs with an alarm
    fill.
    """
    runs = motions.peaks.shape[1]
    over = motions.peaks > np.float32(margin)
    count, hours = int(over.sum()), float(motions.hours.sum())
    if runs == 1:
        return alarm_rate(count, hours, CONFIDENCE)
    high = alarm_rate(int(over.any(axis=1).sum()), hours / runs, CONFIDENCE).high
    low = alarm_rate(count // runs, hours / runs, CONFIDENCE).low
    return AlarmRate(count, hours, count / hours, low, high)


def hours_to_show(per_hour: float) -> float:
    """Hours without any alarm whose interval ends at a rate."""
    return alarm_rate(0, 1.0, CONFIDENCE).high / per_hour
