"""How much time the cue leaves: from the pull to the harm, where nobody reacts."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report import facts as run_facts
from ravenjax.report.reactions import Pairs
from ravenjax.stats.intervals import Rate, wilson
from ravenjax.stats.latency import Lead, lead_time
from ravenjax.studies import reacting_measures as measures
from ravenjax.studies.reacting_pairs import Runs

LIMIT = "param:monitor.moved"
"""How far off the model counts as moved, m: crossed, so that one campaign times harm of every size."""
DELAY = "param:reaction.delay_ms"
DELAYS_MS = (150, 250, 400)


class Advance(NamedTuple):
    """How far ahead of harm of one size the cue came, over runs in which nobody reacted and the instrument moved so."""

    threshold_mm: float
    size_mm: float | None  # None: a jump of the true tip
    lead: Lead  # ms
    late: dict[int, Rate]  # reaction time, ms -> share of harms that come too soon for it, or without a cue


def of_size(runs: Runs, size_mm: float) -> Runs:
    """Runs with a fault that changed a bit and whose `moved_first_ms` is that of this size."""
    return runs.where(np.isclose(runs.frame[LIMIT] * 1e3, size_mm) & runs.facts["activated"].to_numpy())


def harm_ms(runs: Runs, size_mm: float | None) -> np.ndarray:
    """When each of the runs `of_size` left its model by so much while live, the instrument itself having moved so far;
    None: when its true tip jumped. NaN: never."""
    frame = runs.frame
    if size_mm is None:
        came = np.where(frame["jump_tip"], frame["jump_tip_first_ms"], -1)
        return np.where(came >= 0, came, np.nan)
    came = run_facts.own(frame["moved_first_ms"].to_numpy(), frame["twin_moved_first_ms"].to_numpy())
    return np.where((came >= 0) & measures.stray(size_mm).hits(frame, runs.facts), came, np.nan)


def leads_ms(runs: Runs, cue: int, size_mm: float | None) -> np.ndarray:
    """Time from cue to harm of every run, negative: the cue came after; NaN: no harm; -inf: no cue."""
    cued = run_facts.warned(runs.frame, cue)
    lead = np.where(cued >= 0, harm_ms(runs, size_mm) - cued, -np.inf)
    return np.where(np.isnan(harm_ms(runs, size_mm)), np.nan, lead)


def advance(runs: Runs, cue: int, threshold_mm: float, size_mm: float | None) -> Advance:
    """Of the runs `of_size`; `cue`: number of the haptic set with that threshold."""
    lead, cued = leads_ms(runs, cue, size_mm), run_facts.warned(runs.frame, cue)
    found = lead_time(np.where(cued >= 0, cued, np.nan), harm_ms(runs, size_mm), float(runs.end_ms))
    came = lead[~np.isnan(lead)]
    late = {delay: wilson(int((came < delay).sum()), len(came)) for delay in DELAYS_MS}
    return Advance(threshold_mm, size_mm, found, late)


LEFT_MS = (0, 50, 200)
"""Edges of the classes of the time that was left after the operator's own reaction time."""


def left_by_time(timed: Runs, runs: Runs, pairs: Pairs, size_mm: float) -> dict[str, tuple[int, int]]:
    """Harms of this size by the time that was left after the reaction: name -> (without, still there with it).

    timed: a campaign of the same faults in the same order as `runs`, in which nobody reacts; pairs: of `runs`. The harm
    is that while live. ValueError where the two campaigns have other faults.
    """
    lead = leads_ms(of_size(timed, size_mm), 0, size_mm)[_places(timed, runs, pairs, size_mm)]
    left = lead - pairs.with_frame[DELAY].to_numpy(float)
    still = measures.live(size_mm).hits(pairs.with_frame, pairs.with_facts)
    edges = (-np.inf, *LEFT_MS, np.inf)
    names = (
        "none: too soon for this operator",
        *(f"{low} to {high} ms" for low, high in itertools.pairwise(LEFT_MS)),
        f"{LEFT_MS[-1]} ms and more",
    )
    found = {"no cue, or not before the harm": lead <= 0}
    for name, (low, high) in zip(names, itertools.pairwise(edges), strict=True):
        found[name] = (lead > 0) & (left >= low) & (left < high)
    return {name: (int(mine.sum()), int((mine & still).sum())) for name, mine in found.items()}


def _places(timed: Runs, runs: Runs, pairs: Pairs, size_mm: float) -> np.ndarray:
    """Of each pair, the place of its fault among the timed runs `of_size`."""
    faults, others = (np.unique(one.frame["pair"]) for one in (runs, timed))
    if len(faults) != len(others):
        raise ValueError(f"{len(others)} faults were timed and {len(faults)} were paired; both need the same campaign")
    partner = others[np.searchsorted(faults, pairs.without_frame["pair"])]
    sized = of_size(timed, size_mm).frame
    place = pd.Index(sized["pair"]).get_indexer(pd.Index(partner))
    same = ["group", "fault0_start_ms", "fault0_duration_ms"]
    there = sized.iloc[place][same].reset_index(drop=True)
    if (place < 0).any() or not there.equals(pairs.without_frame[same].reset_index(drop=True)):
        raise ValueError("the faults that were timed are not those that were paired; both need the same campaign")
    return place
