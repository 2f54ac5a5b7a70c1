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

from ravenjax.analyses.monitors.counterfactual.candidates import (
    MARGINS,
    SELECTION_MARGIN_INDEX,
    Question,
)
from ravenjax.analyses.monitors.counterfactual.observation import EvadingFaults, FreeMotion
from ravenjax.stats import units
from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.intervals import Rate


def select_greedily(covered: np.ndarray, max_count: int, min_gain: float = 0.0) -> list[int]:
    """Select at most `max_count` candidates greedily and return their indices.

    `covered` (bool [runs, candidates]) tells which candidate covers which run. Each step selects
    the candidate that covers most of the runs that are still uncovered. Of equal candidates it
    selects the first. Selection ends when a candidate would add less than the share `min_gain` of
    all runs. At the end, a candidate is removed if the others cover all of its runs.

    Coverage is submodular, so a greedy set of k covers at least 1 - 1/e of the best set of k
    (Nemhauser, Wolsey, Fisher, Math. Program. 14, 1978).
    """
    runs, candidates = covered.shape
    uncovered, picks = np.ones(runs, bool), []
    while len(picks) < min(max_count, candidates):
        gain = covered[uncovered].sum(axis=0)
        best = int(np.argmax(gain))
        if not gain[best] or gain[best] < min_gain * runs:
            break
        picks.append(best)
        uncovered &= ~covered[:, best]
    kept = list(picks)
    for pick in reversed(picks):
        others = [other for other in kept if other != pick]
        if others and not (covered[:, pick] & ~covered[:, others].any(axis=1)).any():
            kept = others
    return kept


MIN_GAIN = 0.01
"""Share of the faults that a candidate must add to be selected."""
RANDOM_SETS = 200


class Margin(NamedTuple):
    """The factor on the scales above which a set of candidates raises an alarm."""

    index: int  # index into MARGINS
    # Expected alarms per hour in a new motion, from `calibrate_margin`. It is at most the target
    # rate, or else the smallest possible rate.
    expected_per_hour: float

    @property
    def value(self) -> float:
        """The factor on the scales."""
        return MARGINS[self.index]


class CheckSet(NamedTuple):
    """A set of candidate checks with its margin, its false alarms and its coverage."""

    indices: tuple[int, ...]  # of the set's candidates, among all candidates
    margin: Margin
    false_alarms: AlarmRate  # in the test motions
    selection_coverage: Rate  # share of the faults for selection that the set detects in time
    test_coverage: Rate  # share of the faults for the test that the set detects in time
    # Median time from the first alarm to the harm, over covered faults of the test; NaN if none.
    median_lead_ms: float


class Evidence(NamedTuple):
    """Fault-free motions and evading faults, from which coverage and false alarms are computed."""

    question: Question
    calibration_motions: FreeMotion  # motions that determine margins
    test_motions: FreeMotion  # motions that measure false alarms
    faults: EvadingFaults
    selection_half: np.ndarray  # bool [runs], faults with which a set is selected
    test_half: np.ndarray  # bool [runs], faults with which the coverage of a set is measured

    def assess(self, indices: Sequence[int]) -> CheckSet:
        """Return the set of the candidates `indices` with its margin, false alarms and coverage.

        The set detects a fault in time if an alarm comes at least `question.lead_ms` before harm.
        """
        margin = self.margin(indices)
        lead_ms = self.lead_times(indices, margin.index)
        in_time = lead_ms >= self.question.lead_ms
        tested_in_time = in_time & self.test_half
        return CheckSet(
            indices=tuple(indices),
            margin=margin,
            false_alarms=false_alarm_rate(join_scores(self.test_motions, indices), margin.value),
            selection_coverage=self.faults.rate(in_time, self.selection_half),
            test_coverage=self.faults.rate(in_time, self.test_half),
            median_lead_ms=(
                float(np.median(lead_ms[tested_in_time])) if tested_in_time.any() else float("nan")
            ),
        )

    def margin(self, indices: Sequence[int]) -> Margin:
        """Return the smallest margin with which a set keeps the requested rate of false alarms."""
        motions = join_scores(self.calibration_motions, indices)
        return calibrate_margin(motions, self.question.false_alarms_per_hour)

    def lead_times(self, indices: Sequence[int], margin_index: int) -> np.ndarray:
        """Return the time from the first alarm of a set to the harm, ms [runs]. indices: the
        candidates of the set. margin_index: index of the set's margin in MARGINS.
        """
        return self.faults.lead_ms[:, list(indices), margin_index].max(axis=1)

    def detects_in_time(self, indices: Sequence[int]) -> np.ndarray:
        """Return which faults a set detects in time with its own margin, bool [runs]."""
        lead_ms = self.lead_times(indices, self.margin(indices).index)
        return lead_ms >= self.question.lead_ms

    def select_set(self, without_group: str | None = None) -> list[int]:
        """Select a set of candidate checks greedily, and return the indices of its candidates.

        The set detects many faults of `selection_half` in time, with at most `question.most`
        candidates. Faults of the group `without_group` are not used.
        """
        used = self.selection_half
        if without_group is not None:
            used = used & (self.faults.group != without_group)
        # Margins depend on the set, which is unknown so far, so all candidates have one margin.
        in_time = self.faults.lead_ms[used, :, SELECTION_MARGIN_INDEX] >= self.question.lead_ms
        return select_greedily(in_time, self.question.most, min_gain=MIN_GAIN)

    def coverage_of_new_groups(self) -> Rate | None:
        """Estimate the coverage of kinds of faults that are unknown so far.

        For each group, a set of checks is selected by the faults of all other groups. The result is
        the share of the test half's faults that are detected in time by the set that was selected
        without their group; None if there is only one group. The interval is over groups.
        """
        group = self.faults.group
        if len(np.unique(group)) < 2:
            return None
        detected = np.zeros(self.faults.count, bool)
        for name in np.unique(group[self.test_half]):
            indices = self.select_set(without_group=str(name))
            # A selection from the other groups can be empty.
            if indices:
                detected |= (group == name) & self.detects_in_time(indices)
        return units.rate_band(detected[self.test_half], units.group_units(group[self.test_half]))

    def random_set_coverages(self, size: int) -> np.ndarray:
        """Return the share of the test half's faults that each of RANDOM_SETS random sets of `size`
        candidates detects in time, [RANDOM_SETS].
        """
        # The number 2 separates these draws from others with the same seed.
        rng = np.random.default_rng([self.question.seed, 2])
        candidates = self.faults.lead_ms.shape[1]
        sets = [rng.choice(candidates, size, replace=False) for _ in range(RANDOM_SETS)]
        return np.array(
            [self.detects_in_time(indices.tolist())[self.test_half].mean() for indices in sets]
        )


def join_scores(motions: FreeMotion, indices: Sequence[int]) -> FreeMotion:
    """Return the motions with the largest score of a set's candidates, peaks [motions, runs]."""
    return motions._replace(peaks=motions.peaks[:, :, list(indices)].max(axis=2))


def calibrate_margin(motions: FreeMotion, per_hour: float) -> Margin:
    """Return the smallest margin whose expected rate of false alarms is at most `per_hour`.

    The method is conformal risk control. n motions with r runs each have k alarms in total. A new
    motion has at most r alarms, so (k + r) / (n + 1) bounds its expected number if motions are
    exchangeable. The margin is the smallest whose bound per hour is at most the target. A single
    calibration may have a higher rate, because the expectation is also over calibrations. If no
    margin keeps the target, the result is the smallest margin with the lowest bound.
    """
    motion_count, runs = motions.peaks.shape
    hours_per_motion = float(motions.hours.sum(axis=1).mean())
    alarms = [int((motions.peaks > np.float32(margin)).sum()) for margin in MARGINS]
    rates = [(count + runs) / (motion_count + 1) / hours_per_motion for count in alarms]
    # A rate that equals the limit except for rounding keeps the limit.
    limit = max(per_hour, min(rates)) * (1 + 1e-12)
    index = next(index for index, rate in enumerate(rates) if rate <= limit)
    return Margin(index, rates[index])


def false_alarm_rate(motions: FreeMotion, margin: float) -> AlarmRate:
    """Return the rate of false alarms at a margin, with the exact interval of a Poisson rate.

    A run counts at most one alarm. If a motion has several runs, they are not independent. The
    interval is then that of a count of motions, in the hours of one run per motion. For its upper
    end, motions with an alarm in any run are counted. For its lower end, the number of alarms is
    divided by the runs per motion and rounded down, as if motions had an alarm in each run or none.
    """
    runs = motions.peaks.shape[1]
    alarmed = motions.peaks > np.float32(margin)
    count, hours = int(alarmed.sum()), float(motions.hours.sum())
    if runs == 1:
        return alarm_rate(count, hours)
    high = alarm_rate(int(alarmed.any(axis=1).sum()), hours / runs).high
    low = alarm_rate(count // runs, hours / runs).low
    return AlarmRate(count, hours, count / hours, low, high)
