"""How much time the cue leaves: from the pull to the unintended motion, where nobody reacts.

A run tells when its tip first was farther off than the campaign's limit, so each size has a
campaign of its own.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.data import facts as run_facts
from ravenjax.report.sections.reaction.pairs import Pairs
from ravenjax.stats import latency
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import Lead, lead_time
from studies.framework import kinds
from studies.reaction import measures
from studies.reaction import pairs as reacting_pairs
from studies.reaction.pairs import ReactionRuns

DELAY = "param:reaction.delay_ms"
DELAYS_MS = (150, 250, 400)


class Advance(NamedTuple):
    """How far ahead of unintended motion of one size the cue came, over runs in which nobody
    reacted.
    """

    threshold_mm: float
    size_mm: float | None  # None: a jump of the true tip
    kinds: Units  # of the faults that make the motion
    lead: Lead  # ms; its bands take faults as independent
    # motions with the cue before them; this and what follows with intervals over kinds of faults
    before: Rate
    half_ms: Estimate  # lead that half of the motions have or exceed
    quarter_ms: Estimate
    late: dict[
        int, Rate
    ]  # reaction time, ms -> share of motions that come too soon for it, or without a cue


def unreacted(runs: ReactionRuns) -> ReactionRuns:
    """Runs with a fault that changed a bit, in which nobody reacts."""
    return runs.where((runs.facts["activated"] & (runs.facts["action"] == 0)).to_numpy())


def began_ms(runs: ReactionRuns, jump: bool = False) -> np.ndarray:
    """When the unintended motion of each run exceeded the limit of its campaign; `jump`: when its
    true tip jumped. NaN: never."""
    if jump:
        came = np.where(runs.frame["jump_tip"], runs.frame["jump_tip_first_ms"], -1)
    else:
        came = runs.facts["unintended_ms"].to_numpy()
    return np.where(came >= 0, came, np.nan)


def leads_ms(runs: ReactionRuns, cue: int, jump: bool = False) -> np.ndarray:
    """Time from cue to motion of every run, negative: the cue came after; NaN: no motion; -inf:
    no cue.
    """
    cued, began = run_facts.warned(runs.frame, cue), began_ms(runs, jump)
    return np.where(np.isnan(began), np.nan, np.where(cued >= 0, began - cued, -np.inf))


def advance(runs: ReactionRuns, cue: int, threshold_mm: float, jump: bool = False) -> Advance:
    """Of runs in which nobody reacts; `cue`: number of the haptic set with that threshold;
    `jump`: as `began_ms`.
    """
    lead, cued = leads_ms(runs, cue, jump), run_facts.warned(runs.frame, cue)
    began = began_ms(runs, jump)
    lead_curve = lead_time(np.where(cued >= 0, cued, np.nan), began, float(runs.end_ms))
    moved = ~np.isnan(lead)
    came, among = lead[moved], kinds.of(runs.facts["group"].to_numpy()[moved])
    cue_came = np.isfinite(came)
    lag = np.where(cue_came, -came, runs.end_ms - began[moved])

    def exceeded(fraction: float) -> Estimate:
        value, low, high = latency.quantile(lag, cue_came, fraction, among)
        return Estimate(-value, -high, -low)

    return Advance(
        threshold_mm,
        None if jump else runs.limit_mm,
        among,
        lead_curve,
        units.rate(came > 0, among),
        exceeded(0.5),
        exceeded(0.25),
        {delay: units.rate(came < delay, among) for delay in DELAYS_MS},
    )


LEFT_MS = (0, 50, 200)
"""Edges of the classes of the time that was left after the operator's own reaction time."""


def left_by_time(
    timed: ReactionRuns, runs: ReactionRuns, pairs: Pairs
) -> dict[str, tuple[Rate, Units]]:
    """Unintended motions of the size of `timed` by the time that was left after the reaction: name
    -> of the motions where nobody reacts, those that are gone with the reaction; kinds of their
    faults.

    timed: a campaign of the same faults in the same order as `runs`, in which nobody reacts; pairs:
    of `runs`. With the reaction the motion counts live or not. ValueError where the two campaigns
    have other faults.
    """
    alone = unreacted(timed)
    lead = leads_ms(alone, 0)[_places(timed, alone, runs, pairs)]
    left = lead - pairs.with_frame[DELAY].to_numpy(float)
    still = measures.excursion(timed.limit_mm).hits(pairs.with_frame, pairs.with_facts)
    edges = (-np.inf, *LEFT_MS, np.inf)
    names = (
        "none: too soon for this operator",
        *(f"{low} to {high} ms" for low, high in itertools.pairwise(LEFT_MS)),
        f"{LEFT_MS[-1]} ms and more",
    )
    members = {"no cue, or not before the motion": lead <= 0}
    for name, (low, high) in zip(names, itertools.pairwise(edges), strict=True):
        members[name] = (lead > 0) & (left >= low) & (left < high)
    among = reacting_pairs.kinds_of(pairs)
    return {
        name: (units.rate(~still[mine], among.where(mine)), among.where(mine))
        for name, mine in members.items()
    }


def _places(
    timed: ReactionRuns, alone: ReactionRuns, runs: ReactionRuns, pairs: Pairs
) -> np.ndarray:
    """Of each pair, the place of its fault among `alone`, those of the timed runs that count."""
    faults, others = (np.unique(one.frame["pair"]) for one in (runs, timed))
    if len(faults) != len(others):
        raise ValueError(
            f"{len(others)} faults were timed and {len(faults)} were paired; both need the same"
            " campaign"
        )
    partner = others[np.searchsorted(faults, pairs.without_frame["pair"])]
    place = pd.Index(alone.frame["pair"]).get_indexer(pd.Index(partner))
    same = ["group", "fault0_start_ms", "fault0_duration_ms"]
    there = alone.frame.iloc[place][same].reset_index(drop=True)
    if (place < 0).any() or not there.equals(pairs.without_frame[same].reset_index(drop=True)):
        raise ValueError(
            "the faults that were timed are not those that were paired; both need the same campaign"
        )
    return place
