"""Pairs of runs of one fault, with an operator who reacts and without: what the reaction avoided
and what it caused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import library
from ravenjax.hazards.naming import hazards_of
from ravenjax.report.data import facts as run_facts
from ravenjax.report.sections.reaction import pairs as reactions
from ravenjax.report.sections.reaction.pairs import EXCURSION, Pairs
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison.clustered import exchange_p
from ravenjax.stats.comparison.paired import mcnemar
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.multiplicity import holm
from ravenjax.store import folder, manifest
from studies.framework import kinds
from studies.framework.kinds import difference
from studies.reaction.measures import Measure

SPEEDS_MS = (0, 50, 200, 500, 1000)
"""Edges of the classes of how soon after its first effect a fault moves the tip where nobody
reacts.
"""


class ReactionRuns(NamedTuple):
    """A variant's result table, with a column EXCURSION, and its facts."""

    frame: pd.DataFrame
    facts: pd.DataFrame
    end_ms: int
    limit_mm: float  # of the hazards in facts

    def where(self, chosen: np.ndarray) -> ReactionRuns:
        """Those of `chosen` (bool [runs])."""
        return self._replace(frame=self.frame.loc[chosen], facts=self.facts.loc[chosen])


class Contrast(NamedTuple):
    """One measure over pairs. Intervals are over kinds of faults."""

    n: int  # distinct faults, each one pair
    kinds: Units  # of these faults
    without: int  # faults that have it where nobody reacts
    with_: int  # with the reaction
    # with the reaction minus without, fraction of the faults: negative is what it avoids
    difference: Estimate
    avoided: (
        Rate  # of the faults that have it where nobody reacts, those without it with the reaction
    )
    affected: Units  # kinds of the faults that have it where nobody reacts
    caused: int  # faults that have it with the reaction alone
    p: float  # exact, labels exchanged kind by kind; NaN where no pair differs
    acted: int  # pairs in which the operator acted
    reacted: Units  # kinds of their faults
    needed: Estimate  # reactions for each one avoided; infinite where none is


def read(path: Path) -> ReactionRuns:
    """The runs of a result folder. Raises StoreError."""
    frame, header = folder.read_all(path), manifest.read(path)
    frame[EXCURSION] = frame[["unintended_mm", "unintended_off_mm"]].max(axis=1)
    return ReactionRuns(frame, run_facts.of(frame, header), header.duration_ms, header.limit_mm)


def paired(runs: ReactionRuns, action: int) -> Pairs:
    """Every fault that changed a bit where nobody reacts, with this action and without one."""
    every = reactions.pairs(runs.frame, runs.facts, action)
    return every.where(every.without_facts["activated"].to_numpy())


def kinds_of(pairs: Pairs) -> Units:
    """Kinds of the faults of these pairs."""
    return kinds.of(pairs.with_facts["group"])


def contrast(pairs: Pairs, measure: Measure) -> Contrast:
    """The measure over these pairs."""
    with_ = measure.hits(pairs.with_frame, pairs.with_facts)
    without = measure.hits(pairs.without_frame, pairs.without_facts)
    acted = (pairs.with_frame["reaction_ms"] >= 0).to_numpy()
    among = kinds_of(pairs)
    affected = among.where(without)
    return Contrast(
        len(with_),
        among,
        int(without.sum()),
        int(with_.sum()),
        difference(with_, without, among),
        units.rate(~with_[without], affected),
        affected,
        mcnemar(with_, without).first_only,
        exchange_p(with_, without, among.unit),
        int(acted.sum()),
        among.where(acted),
        needed(difference(with_[acted], without[acted], among.where(acted))),
    )


def needed(difference: Estimate) -> Estimate:
    """Number needed to treat from a difference of rates (negative: fewer), infinite where nothing
    is avoided.

    Its interval is the reciprocal of the difference's (Altman, BMJ 317, 1998); an end that includes
    no effect is infinite.
    """

    def reciprocal(rate: float) -> float:
        return -1.0 / rate if rate < 0 else math.inf

    def end(rate: float) -> float:
        return math.nan if math.isnan(rate) else reciprocal(rate)

    return Estimate(*map(end, difference))


def mean_change(pairs: Pairs, column: str) -> Estimate:
    """Mean of a column with the reaction minus without, its interval over kinds of faults; NaN
    without pairs.
    """
    if not len(pairs.with_frame):
        return Estimate(math.nan, math.nan, math.nan)
    with_, without = (
        part[column].to_numpy(float) for part in (pairs.with_frame, pairs.without_frame)
    )
    band = units.ratio(with_ - without, 1.0, kinds_of(pairs))
    return Estimate(band.value, band.low, band.high)


def adjusted(contrasts: Sequence[Contrast]) -> list[float]:
    """Holm's p of each, of all of them together; NaN where no pair differs."""
    return [
        finding.adjusted
        for finding in holm({str(k): one.p for k, one in enumerate(contrasts)}).values()
    ]


# --- classes of faults: name -> which pairs ---


def by_design(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """Sampled faults, and those of the library."""
    group = pairs.with_facts["group"].astype(str)
    sampled = group.str.startswith("sampled/").to_numpy()
    return {"sampled faults": sampled, "hazards of the library": ~sampled}


def by_layer(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """Layer of the first fault, in the robot's order."""
    from ravenjax.robots.raven2.layers import LAYERS

    layer = pairs.with_facts["layer"].to_numpy()
    return {name: mine for name in LAYERS.values() if (mine := layer == name).any()}


def by_scenario(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """Training scenario and hazard of the analysis, of runs that are a row of the library."""
    rows = {row.id: row for row in library.rows()}
    named = [
        [rows[name] for name in hazards_of(group)]
        for group in pairs.with_facts["group"].astype(str)
    ]
    scenarios = dict.fromkeys(name for row in rows.values() for name in row.scenarios)
    hazards = dict.fromkeys(name for row in rows.values() for name in row.hazards)

    def masks() -> Iterator[tuple[str, np.ndarray]]:
        for name in scenarios:
            yield (
                f"scenario: {name}",
                np.array([any(name in row.scenarios for row in has) for has in named], bool),
            )
        for name in sorted(hazards):
            words = library.terms()["hazards"][name]
            yield (
                f"{name}: {words}",
                np.array([any(name in row.hazards for row in has) for has in named], bool),
            )

    return {name: mine for name, mine in masks() if mine.any()}


def by_speed(pairs: Pairs) -> Mapping[str, np.ndarray]:
    """How soon after its first effect the fault makes an unintended motion where nobody reacts."""
    facts = pairs.without_facts
    after = np.where(facts["unintended"], facts["unintended_ms"] - facts["active_ms"], -1)
    members: dict[str, np.ndarray] = {}
    for low, high in zip(SPEEDS_MS, (*SPEEDS_MS[1:], None), strict=True):
        words = f"after {low} to {high} ms" if high else f"after {low} ms or more"
        members[words] = (after >= low) & ((after < high) if high else True)
    return {**members, "no unintended motion": after < 0}
