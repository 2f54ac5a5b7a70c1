"""Compares the groups of a study: effect sizes, intervals and adjusted p-values of all outcomes.

Outcomes are rates, times and sizes. Participants were randomised, and the hazards of one
participant are not independent, so every interval and p-value counts participants. If most
participants did both conditions, each is compared with themselves.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ravenjax.stats import multiplicity
from ravenjax.stats.comparison import clustered
from ravenjax.stats.intervals import Estimate
from ravenjax.train.judge.episode import HazardRow
from ravenjax.train.study.sessions import TrainingStudy

CONFIDENCE = 0.95
_ALIKE = 1e-9
"""ms, mm or a share: smaller differences are rounding errors."""
_NONE = Estimate(math.nan, math.nan, math.nan)


class ComparedOutcome(NamedTuple):
    """An outcome that is compared for each hazard. Its value is None for a hazard without one."""

    name: str
    unit: str
    digits: int
    # 1: more is better, -1: less is better.
    better: int
    value: Callable[[HazardRow], float | None]


def _response_ms(hazard: HazardRow) -> float | None:
    """Return the time to the response, infinite without one; None if none was right."""
    return None if hazard.right_response == "continue" else hazard.after.get("response", math.inf)


RIGHT = ComparedOutcome("right response", "%", 0, 1, lambda hazard: 100.0 * hazard.response_ok)
TIME = ComparedOutcome("time to a response", "ms", 0, -1, _response_ms)
OUTCOMES = (
    RIGHT,
    TIME,
    ComparedOutcome("largest unintended motion", "mm", 1, -1, lambda hazard: hazard.farthest_mm),
    ComparedOutcome(
        *("deepest in the tissue", "mm", 1, -1),
        lambda hazard: None if hazard.deepest_mm is None else max(0.0, hazard.deepest_mm),
    ),
)


class ComparedGroup(NamedTuple):
    """One side of a comparison of one outcome."""

    label: str
    # Participants' means; times are limited to the horizon.
    means: np.ndarray
    # Values of all hazards; a time without a response is inf.
    values: np.ndarray

    @property
    def mean(self) -> float:
        """Mean of the participants' means."""
        return float(np.mean(self.means)) if len(self.means) else math.nan

    @property
    def median(self) -> float:
        """Median of the hazards; infinite if half of them had no response."""
        ordered = np.sort(self.values)
        return float(ordered[(len(ordered) - 1) // 2]) if len(ordered) else math.nan


class GroupComparison(NamedTuple):
    """One outcome of `second` against the reference `first`. Differences are second - first."""

    outcome: ComparedOutcome
    first: ComparedGroup
    second: ComparedGroup
    paired: bool
    # Of rates in percentage points, otherwise of participants' means.
    difference: Estimate
    # Standardised difference of participants' means.
    g: Estimate
    # By a permutation test between, or within, participants. NaN: there is nothing to test.
    p: float
    # Number of participants whose conditions do not fit the design.
    left_out: int
    # p adjusted by Holm over all outcomes that vary and pairs of groups.
    adjusted: float = math.nan
    # Whether `adjusted` is below 1 - CONFIDENCE.
    clear: bool = False

    @property
    def people(self) -> int:
        return len(self.first.means) + (0 if self.paired else len(self.second.means))

    @property
    def sign(self) -> int:
        """1 if the group did better than the reference, otherwise -1."""
        return 1 if self.difference.value * self.outcome.better > 0 else -1

    @property
    def has_few(self) -> bool:
        return min(len(self.first.means), len(self.second.means)) < 2


def compare_groups(study: TrainingStudy) -> list[GroupComparison]:
    """Compare each group with the reference, the first of `study.labels`, on every outcome."""
    first, *others = study.labels.values()
    comparisons = [
        _compare(study, outcome, first, label) for label in others for outcome in OUTCOMES
    ]
    p_values = {str(i): comparison.p for i, comparison in enumerate(comparisons)}
    findings = multiplicity.holm_test(p_values, CONFIDENCE)
    return [
        comparison._replace(adjusted=findings[str(i)].adjusted, clear=findings[str(i)].rejected)
        for i, comparison in enumerate(comparisons)
    ]


def _compare(
    study: TrainingStudy, outcome: ComparedOutcome, first: str, second: str
) -> GroupComparison:
    horizon = study.horizon_ms() if outcome is TIME else math.inf
    sides = [_values_by_person(study, outcome, label, horizon) for label in (first, second)]
    both, everyone = sides[0].keys() & sides[1].keys(), sides[0].keys() | sides[1].keys()
    is_paired = 2 * len(both) > len(everyone)
    members = [sorted(both)] * 2 if is_paired else [sorted(side.keys() - both) for side in sides]
    one, two = ([side[name] for name in names] for side, names in zip(sides, members, strict=True))
    limited_one, limited_two = (
        [np.minimum(values, horizon) for values in side] for side in (one, two)
    )
    if outcome is RIGHT:
        risk = clustered.paired_risk_difference if is_paired else clustered.risk_difference
        share = risk([hits / 100.0 for hits in two], [hits / 100.0 for hits in one], CONFIDENCE)
        difference = Estimate(100.0 * share.value, 100.0 * share.low, 100.0 * share.high)
    else:
        difference = clustered.mean_difference(
            limited_two, limited_one, CONFIDENCE, is_paired=is_paired
        )
    means = clustered.cluster_means(limited_one), clustered.cluster_means(limited_two)
    g, p = _NONE, math.nan
    if min(map(len, means)) > 1:
        standardised = clustered.standardised_difference(means[1], means[0], is_paired=is_paired)
        g = Estimate(standardised, math.nan, math.nan)
        # Whether permuting conditions could change anything. The check does not use which group is
        # which, so leaving out outcomes that do not vary favours no result.
        spread = np.abs(means[0] - means[1]).max() if is_paired else np.ptp(np.concatenate(means))
        if spread > _ALIKE:
            p = clustered.permutation_p(limited_two, limited_one, is_paired=is_paired)
    return GroupComparison(
        outcome,
        ComparedGroup(first, means[0], np.concatenate([*one, np.zeros(0)])),
        ComparedGroup(second, means[1], np.concatenate([*two, np.zeros(0)])),
        paired=is_paired,
        difference=difference,
        g=g,
        p=p,
        left_out=len(everyone - set(members[0]) - set(members[1])),
    )


def _values_by_person(
    study: TrainingStudy, outcome: ComparedOutcome, label: str, horizon: float
) -> dict[str, np.ndarray]:
    """Return the values of each participant's hazards, infinite after the horizon."""
    values: dict[str, list[float]] = {}
    for session, group, hazard in study.rows():
        value = outcome.value(hazard) if group == label else None
        if value is not None:
            values.setdefault(session.person, []).append(math.inf if value > horizon else value)
    return {name: np.array(numbers) for name, numbers in values.items()}
