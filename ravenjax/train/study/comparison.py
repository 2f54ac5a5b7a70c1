"""Compares the groups of a study: rates, times and sizes with effect sizes, intervals and adjusted
p-values.

Participants are what was randomised, and hazards of one participant are not independent: every
interval and p-value counts participants. Where most of them did both conditions, each is compared
with itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ravenjax.stats import multiplicity
from ravenjax.stats.bootstrap.resample import BootstrapBand
from ravenjax.stats.comparison import clustered, effect_size
from ravenjax.stats.intervals import Estimate, Rate, wilson
from ravenjax.train.judge.row import HazardRow
from ravenjax.train.study.table import TrainingStudy

_ALIKE = 1e-9  # ms, mm or a share: rounding
_NONE = Estimate(math.nan, math.nan, math.nan)


class ComparedOutcome(NamedTuple):
    """What is compared of each hazard."""

    key: str
    name: str
    unit: str
    better: int  # 1: more is better, -1: less
    value: Callable[[HazardRow], float | None]


def _time(hazard: HazardRow) -> float | None:
    """None where the right response was to carry on: there is none to wait for."""
    return None if hazard.right_response == "continue" else hazard.after.get("response", math.inf)


RIGHT = ComparedOutcome("right", "right response", "", 1, lambda one: float(one.response_ok))
TIME = ComparedOutcome("time", "time to a response", "ms", -1, _time)
SIZES = (
    ComparedOutcome(
        "unintended", "largest unintended motion", "mm", -1, lambda one: one.farthest_mm
    ),
    ComparedOutcome(
        "depth",
        "deepest in the tissue",
        "mm",
        -1,
        lambda one: None if one.deepest_mm is None else max(0.0, one.deepest_mm),
    ),
)
OUTCOMES = (RIGHT, TIME, *SIZES)


class ComparedGroup(NamedTuple):
    """One side of a comparison, of one outcome."""

    label: str
    participants: int
    hazards: int
    rate: Rate | None  # of right responses
    mean: float  # of participants' means
    median: float  # of hazards; of a time inf where half had no response
    points: list[float]  # participants' means


class GroupComparison(NamedTuple):
    """One outcome, `second` against the reference `first`: differences are second - first."""

    outcome: ComparedOutcome
    first: ComparedGroup
    second: ComparedGroup
    paired: bool
    difference: Estimate  # of rates (fraction), of means (unit)
    median: BootstrapBand | None  # difference of medians, participants resampled
    g: Estimate  # standardised difference of participants' means
    delta: Estimate  # Cliff's, of participants' means
    icc: float  # likeness of hazards of one participant, NaN where each met one
    p: float  # by exchanging conditions between, or within, participants
    adjusted: float  # by Holm over all outcomes that vary and pairs of groups
    clear: bool  # adjusted p below 1 - confidence
    left_out: int  # participants whose conditions do not fit the design
    varies: bool  # False: exchanging conditions changes nothing, so there is nothing to test


def compare(study: TrainingStudy, confidence: float = 0.95, seed: int = 0) -> list[GroupComparison]:
    """Every outcome, each group against the reference: the first of `study.labels`."""
    first, *others = study.labels.values()
    horizon = horizon_ms(study)
    comparisons = [
        _compared(study, outcome, first, label, horizon, confidence, seed)
        for label in others
        for outcome in OUTCOMES
    ]
    findings = multiplicity.holm({str(i): one.p for i, one in enumerate(comparisons)}, confidence)
    return [
        one._replace(adjusted=findings[str(i)].adjusted, clear=findings[str(i)].rejected)
        for i, one in enumerate(comparisons)
    ]


def horizon_ms(study: TrainingStudy) -> float:
    """Until when every hazard was watched for a response, ms after its strike; later ones count as
    none.

    The shortest time for a response that a hazard of the scenario gives; the longest response seen
    where none tells.
    """
    rows = [(session.watched_ms.get(hazard.number), hazard) for session, _, hazard in study.rows()]
    limits = [limit for limit, _ in rows if limit is not None]
    responses = [hazard.after["response"] for _, hazard in rows if "response" in hazard.after]
    return min(limits) if limits else max(responses, default=1000.0)


def _compared(
    study: TrainingStudy,
    outcome: ComparedOutcome,
    first: str,
    second: str,
    horizon: float,
    confidence: float,
    seed: int,
) -> GroupComparison:
    sides = [_clusters(study, outcome, label, horizon) for label in (first, second)]
    both, everyone = sides[0].keys() & sides[1].keys(), sides[0].keys() | sides[1].keys()
    is_paired = 2 * len(both) > len(everyone)
    members = [sorted(both)] * 2 if is_paired else [sorted(side.keys() - both) for side in sides]
    one, two = ([side[name] for name in names] for side, names in zip(sides, members, strict=True))
    limited_one, limited_two = (
        [np.minimum(values, horizon) for values in side] for side in (one, two)
    )
    if outcome is not TIME:
        limited_one, limited_two = one, two
    if outcome is RIGHT:
        risk = clustered.paired_risk_difference if is_paired else clustered.risk_difference
        difference, median = risk(two, one, confidence), None
    else:
        difference = clustered.mean_difference(
            limited_two, limited_one, confidence, is_paired=is_paired
        )
        median = clustered.bootstrap_difference(
            two, one, _median, confidence, is_paired=is_paired, seed=seed
        )
    means = clustered.means(limited_one), clustered.means(limited_two)
    enough = min(map(len, means)) > 1
    # Whether exchanging conditions could change anything. That is asked without a look at which
    # group is which, so that leaving out what does not vary favours no result.
    varies = False
    if enough:
        spread = np.abs(means[0] - means[1]).max() if is_paired else np.ptp(np.concatenate(means))
        varies = bool(spread > _ALIKE)
    p = math.nan
    if varies:
        p = clustered.permutation_p(limited_two, limited_one, is_paired=is_paired, seed=seed)
    standardised = effect_size.paired_g if is_paired else effect_size.hedges_g
    dominance = effect_size.paired_dominance if is_paired else effect_size.cliffs_delta
    groups = _group(first, one, means[0], outcome), _group(second, two, means[1], outcome)
    return GroupComparison(
        outcome,
        *groups,
        paired=is_paired,
        difference=difference,
        median=median,
        g=standardised(means[1], means[0], confidence) if enough else _NONE,
        delta=dominance(means[1], means[0], confidence) if enough else _NONE,
        icc=clustered.correlation(limited_one, limited_two).icc,
        p=p,
        adjusted=math.nan,
        clear=False,
        left_out=len(everyone - set(members[0]) - set(members[1])),
        varies=varies,
    )


def _clusters(
    study: TrainingStudy, outcome: ComparedOutcome, label: str, horizon: float
) -> dict[str, np.ndarray]:
    """Values of each participant's hazards; a response after the horizon counts as none
    (infinite).
    """
    out: dict[str, list[float]] = {}
    for session, group, hazard in study.rows():
        value = outcome.value(hazard) if group == label else None
        if value is not None:
            is_late = outcome is TIME and value > horizon
            out.setdefault(session.participant, []).append(math.inf if is_late else value)
    return {name: np.array(values) for name, values in out.items()}


def _group(
    label: str, clusters: list[np.ndarray], means: np.ndarray, outcome: ComparedOutcome
) -> ComparedGroup:
    values = np.concatenate([*clusters, np.zeros(0)])
    return ComparedGroup(
        label,
        participants=len(clusters),
        hazards=len(values),
        rate=wilson(int(values.sum()), len(values)) if outcome is RIGHT else None,
        mean=float(np.mean(means)) if len(means) else math.nan,
        median=_median(values) if len(values) else math.nan,
        points=means.tolist(),
    )


def _median(values: np.ndarray) -> float:
    """The least value that half of the values do not exceed; infinite where half never came."""
    return float(np.sort(values)[(len(values) - 1) // 2])
