"""The first page: which faults evade, how long before anyone can know, what the cue would change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report import facts as run_facts
from ravenjax.report import tables
from ravenjax.report.reactions import Difference
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import Incidence, Lead, incidence, lead_time
from ravenjax.store.manifest import Cue, Manifest

CLASSES = {"layer": "Layer", "site": "Site", "group": "Group"}
MOST_CLASSES = 12
"""Rows of the compact table; the rest stand in the evidence."""


class ClassRow(NamedTuple):
    """One class of faults, of runs in which nobody reacts; a fault that was run several times counts once."""

    name: str
    evaded: Rate  # of distinct faults
    harm: Rate  # of distinct faults
    before: Rate  # of harmful faults, those that could be known before the harm
    half_ms: Estimate  # time from the first effect by which half of the harmful faults could be known


class Knowledge(NamedTuple):
    """Time from the first effect to the first possible knowledge, over harmful faults (one run of each)."""

    delay: Incidence
    half_ms: Estimate
    quarter_ms: Estimate
    lead: Lead
    never: Rate  # not known when the run ended
    by_detectors: bool  # the campaign has detectors, which count at their quiet level


class Announced(NamedTuple):
    """Of evading faults that moved the instrument, what a cue announces before it is HARM_MM off."""

    cue: Cue
    lead: Lead
    lead_ms: Estimate  # median
    false: Rate  # of fault-free motions, those with this cue


class Changed(NamedTuple):
    """What the cue would change: pairs where the campaign has them, else what it announces."""

    pairs: list[Difference]  # all faults, one for each reaction
    announced: Announced | None  # by the cue of the verdicts; None: no cue, or nothing evaded and moved
    better: Announced | None  # the cue that announces most without a false one, where it is another


def knowledge(facts: pd.DataFrame, known_ms: np.ndarray, manifest: Manifest) -> Knowledge:
    """known_ms [rows of facts]: when anyone could first know, -1 if never."""
    chosen = _harmful(facts)
    known, active, harm = _times(facts, known_ms, chosen)
    came = ~np.isnan(known)
    delay = incidence(np.where(came, known, manifest.duration_ms) - active, came)
    return Knowledge(
        delay,
        delay.quantile_interval(0.5),
        delay.quantile_interval(0.25),
        lead_time(known, harm, float(manifest.duration_ms)),
        tables.rate(~came),
        bool(manifest.detectors),
    )


def classes(facts: pd.DataFrame, known_ms: np.ndarray, manifest: Manifest) -> dict[str, list[ClassRow]]:
    """Rows by each of CLASSES, most evasive first; a kind of class that is the same for all faults is left out."""
    faulty = (facts["faulty"] & facts["plain"]).to_numpy()
    made = {}
    for kind in CLASSES:
        names = facts[kind].astype(str).to_numpy()
        present = np.unique(names[faulty])
        if len(present) > 1 or (kind == "group" and len(present)):
            rows = [_class(str(name), facts, faulty & (names == name), known_ms, manifest) for name in present]
            made[kind] = sorted(rows, key=lambda row: (-row.evaded.value, -row.harm.value, row.name))
    return made


def changed(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest, differences: Sequence[Difference]) -> Changed:
    """differences: of all reactions, none where the campaign has no pairs."""
    chosen = (facts["sample"] & facts["evaded"] & (facts["moved_ms"] >= 0) & facts["activated"]).to_numpy()
    free = run_facts.motions(frame, facts)
    told = []
    if chosen.any() and len(free):
        told = [_announced(frame, facts, manifest, free, k, chosen) for k in range(len(manifest.cues))]
    first = told[manifest.verdict_cue] if told else None
    quiet = [one for one in told if not one.false.k]
    best = max(quiet, key=lambda one: (one.lead.before.value, one.cue.threshold_mm), default=None)
    better = best if best and first and best.lead.before.k > first.lead.before.k else None
    return Changed([row for row in differences if row.among == "all faults"], first, better)


def _announced(
    frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest, free: pd.DataFrame, k: int, chosen: np.ndarray
) -> Announced:
    warned, _, _ = _times(facts, run_facts.warned(frame, k), chosen)
    lead = lead_time(warned, facts.loc[chosen, "moved_ms"].to_numpy(float), float(manifest.duration_ms))
    false = tables.rate(run_facts.first_came(free, f"twin_cue{k}_first_ms"))
    return Announced(manifest.cues[k], lead, lead.quantile(0.5), false)


def _class(name: str, facts: pd.DataFrame, mine: np.ndarray, known_ms: np.ndarray, manifest: Manifest) -> ClassRow:
    ever = facts.loc[mine, ["evaded", "harm"]].groupby(facts.loc[mine, "distinct"].to_numpy()).any()
    chosen = mine & _harmful(facts)
    known, active, harm = _times(facts, known_ms, chosen)
    came = ~np.isnan(known)
    delay = incidence(np.where(came, known, manifest.duration_ms) - active, came)
    return ClassRow(
        name,
        tables.rate(ever["evaded"]),
        tables.rate(ever["harm"]),
        tables.rate(known < harm),
        delay.quantile_interval(0.5),
    )


def _harmful(facts: pd.DataFrame) -> np.ndarray:
    return (facts["sample"] & facts["faulty"] & facts["activated"] & facts["harm"]).to_numpy()


def _times(facts: pd.DataFrame, event_ms: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the chosen runs: an event (NaN where it never came or before the first effect), first effect, harm; ms."""
    active, harm = (facts.loc[chosen, name].to_numpy(float) for name in ("active_ms", "harm_ms"))
    event = event_ms[chosen].astype(float)
    event[(event < 0) | (event < active)] = np.nan
    return event, active, harm
