"""Sections "Reaction" and "Crossed parameters": compare runs of the same faults with and without
the operator's reaction, and with each value of a crossed parameter.

A pair is two runs that differ in one crossed parameter, or in the reaction. One run is the
reference: the parameter has its first value, or the operator does not react. All other crossed
parameters are equal in both runs. A fault has one pair for each combination of their values.
"""

import math
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.data import pair_intervals as intervals
from ravenjax.report.data.facts import ACTION, FACTS
from ravenjax.report.data.fault_free import MS_PER_HOUR
from ravenjax.report.data.pair_intervals import PairedRates
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.stats.alarms.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.units import Units
from ravenjax.store.access.query import RESULTS, quote_name
from ravenjax.vocabulary.reactions import ACTIONS, MEANINGS

EXCURSION = "excursion_mm"
"""Name of the column with the unintended distance of the tip, in mm.

This is the smallest of several distances: from the golden run, from where the tip would be if the
robot had stood still, and, while the robot is live, from the nominal model. The nominal model
counts because an operator who slows down falls behind the golden run on purpose.
"""
_EXCURSION = f"greatest({RESULTS}.unintended_mm, {RESULTS}.unintended_off_mm)"
MOST_VALUES = 12
"""Largest number of values of a crossed parameter that get their own rows."""
MOST = 400_000
"""Largest number of runs that are compared pair by pair. Of more runs, pairs are drawn."""
EVENTS = {"evaded": "evades", "unintended": "unintended motion", "told": "alarm by a check"}
"""Facts whose rates are listed by the value of a crossed parameter."""
Sampled = Callable[[Collection[str]], bool]
"""Returns whether the faults of some groups were drawn, as `Runs.sampled` does."""


class Pairs(NamedTuple):
    """Pairs of runs with and without a reaction, or with one and the first value of a parameter.

    Row k of both tables is one pair. Failed runs are left out.
    """

    with_: pd.DataFrame
    without: pd.DataFrame

    def where(self, chosen: np.ndarray) -> "Pairs":
        """Return the pairs that `chosen` marks (bool [pairs])."""
        return Pairs(*(part.loc[chosen] for part in self))

    @property
    def acting(self) -> np.ndarray:
        """Whether the fault of each pair changed a bit in at least one of both runs, bool [pairs].

        One run is enough, because a reaction to a false cue may end a run before its fault acts.
        """
        return self.with_["activated"].to_numpy() | self.without["activated"].to_numpy()

    def faults(self, sampled: Sampled) -> Units | None:
        """Return the faults of the pairs as units; None if they were enumerated."""
        drawn = sampled(self.with_["group"].unique().tolist())
        return intervals.pair_faults(self.with_["distinct"].to_numpy(), drawn)


class Difference(NamedTuple):
    """A comparison of runs with a reaction with the same runs without it.

    Differences are with minus without the reaction, so they are negative if the reaction helps.
    """

    action: str  # in words
    among: str  # which pairs: all, a layer, or a value of a crossed parameter
    n: int
    inactive: int  # pairs of this action without any changed bit, which are left out
    without: Rate  # unintended motion without the reaction
    with_: Rate
    change: Estimate  # difference of both rates, a fraction
    spared: int  # pairs with an unintended motion only without the reaction
    caused: int  # pairs with an unintended motion only with the reaction
    p: float  # exact; NaN if nothing was drawn
    # Mean difference of EXCURSION; bounds are NaN for one pair, or if nothing was drawn.
    distance_mm: Estimate
    depth_mm: Estimate  # the same for the depth in tissue
    reacted: Rate  # pairs in which the operator acted
    idle: Rate  # share of reactions for which the other run has no unintended motion


class CrossedRow(NamedTuple):
    """Rates with one value of a crossed parameter, and with the first value in the same faults."""

    parameter: str
    first: float
    value: float
    n: int  # pairs; for the first value: runs
    inactive: int  # pairs that are left out, because their fault changed no bit in either run
    events: dict[str, PairedRates]  # by EVENTS, before: with the first value


class Idle(NamedTuple):
    """Interruptions of fault-free motion."""

    action: str
    motions: Rate  # of fault-free motions: those in which the operator acted
    per_hour: AlarmRate | None
    lost_ms: float  # mean pedal-down time lost in these motions, ms; NaN: none


def sample_runs(runs: Runs) -> pd.DataFrame:
    """Return all runs, or about MOST drawn runs, with the columns that this section reads.

    Runs of one pair are drawn together.
    """
    plain = ("pair", "operator", "reaction_ms", "pedal_down_ms", "tissue_depth_mm")
    names = [name for name in runs.names if name in plain or name.startswith(("param:", "golden_"))]
    facts = (*EVENTS, "failed", "faulty", "activated", "plain", "action", '"distinct"')
    columns = [
        *(f"{RESULTS}.{quote_name(name)}" for name in names),
        f"{_EXCURSION} AS {EXCURSION}",
        *(f"{FACTS}.{name}" for name in facts),
        *(f'{FACTS}."{name}"::VARCHAR AS "{name}"' for name in ("group", "layer")),
    ]
    return runs.drawn(", ".join(columns), "true", MOST, by="pair")


def paired_runs(runs: pd.DataFrame, action: int, faulty: bool = True) -> Pairs:
    """Return every run with this action and its partner in which nobody reacts.

    Other crossed parameters, except those of the reaction, are equal within a pair.
    """
    others = _crossed_names(runs)
    pair_columns = ["pair", *(name for name in others if not name.startswith("param:reaction."))]
    valid = runs.loc[~runs["failed"] & (runs["faulty"] == faulty)]
    # Action 0: nobody reacts.
    reacting, passive = (valid.loc[valid["action"] == number] for number in (action, 0))
    return _matched(reacting, passive, pair_columns, others)


def _matched(
    with_: pd.DataFrame, without: pd.DataFrame, keys: Sequence[str], varied: Sequence[str]
) -> Pairs:
    """Return each run of `with_` with its partner, the run of `without` with equal columns `keys`.
    `distinct` is the number of a fault. Runs with the same fault and the same values of the columns
    `varied` are repetitions and count once.
    """
    partners = without[keys].rename_axis("partner").reset_index().drop_duplicates(keys)
    matched = with_.rename_axis("row").reset_index().merge(partners, on=keys)
    matched = matched.loc[~matched[[*varied, "distinct"]].duplicated()]
    return Pairs(with_.loc[matched["row"]], without.loc[matched["partner"]])


def compare_pairs(runs: pd.DataFrame, sampled: Sampled) -> list[Difference]:
    """Return comparisons by action: all pairs, by layer, and by other crossed parameters.

    Faults that changed no bit in either run are left out.
    """
    comparisons = []
    for number, action in _actions(runs):
        pairs = paired_runs(runs, number)
        acting = pairs.acting
        for among, part in _parts(pairs.where(acting)):
            if len(part.with_):
                inactive = int((~acting).sum())
                comparisons.append(_difference(action, among, part, part.faults(sampled), inactive))
    return comparisons


def crossed_rows(runs: pd.DataFrame, sampled: Sampled) -> list[CrossedRow]:
    """Return rates of runs without a reaction by the value of each crossed parameter, in order.

    Runs of one pair have the same fault. Each value is compared with the value in the pair's first
    run. With values 2, 1 and 3, the rows compare 2 with 2, 1 with 2, and 3 with 2.
    """
    counted = runs.loc[runs["plain"] & runs["faulty"] & ~runs["failed"]]
    crossed = [name for name in _crossed_names(runs) if not name.startswith("param:reaction.")]
    rows = []
    for name in crossed:
        shared = ["pair", *(other for other in crossed if other != name)]
        first_of_pair = runs.groupby("pair")[name].transform("first")[counted.index]
        for first, of_first in counted.groupby(first_of_pair):
            values = of_first[name].dropna().unique().tolist()
            # Without another value there is nothing to compare.
            if set(values) <= {first}:
                continue
            # The first value comes first, then the others in ascending order.
            for value in sorted(values, key=lambda value: (value != first, value)):
                with_value, without = (of_first[of_first[name] == one] for one in (value, first))
                pairs = _matched(with_value, without, shared, crossed)
                # Pairs whose fault changed no bit in either run are only counted.
                acting = pairs.acting
                active_pairs = pairs.where(acting)
                faults = active_pairs.faults(sampled)
                events = {}
                for event, words in EVENTS.items():
                    after, before = (side[event].to_numpy() for side in active_pairs)
                    events[words] = intervals.compare_rates(after, before, faults)
                counts = int(acting.sum()), int((~acting).sum())
                rows.append(CrossedRow(name.removeprefix("param:"), first, value, *counts, events))
    return rows


def count_interruptions(runs: pd.DataFrame) -> list[Idle]:
    """Return for each action how often and how long the operator interrupts fault-free motion."""
    result = []
    for number, action in _actions(runs):
        # Runs that share robot and operator share one golden run, so it counts once.
        names = [name for name in runs if name == "operator" or name.startswith("golden_")]
        motions = runs.loc[runs["action"] == number, names].drop_duplicates()
        acted = int((motions["golden_reaction_ms"] >= 0).sum())
        hours = float(motions["golden_pedal_down_ms"].to_numpy().sum()) / MS_PER_HOUR
        pairs = paired_runs(runs, number, faulty=False)
        lost = pairs.without["pedal_down_ms"].to_numpy() - pairs.with_["pedal_down_ms"].to_numpy()
        lost = lost[pairs.with_["reaction_ms"].to_numpy() >= 0]
        share, rate = tables.wilson_share(acted, len(motions)), alarm_rate(acted, hours)
        lost_ms = float(lost.mean()) if len(lost) else math.nan
        result.append(Idle(MEANINGS[action], share, rate if hours else None, lost_ms))
    return result


def _actions(runs: pd.DataFrame):
    present = runs["action"].unique().tolist()
    return [(n, name) for n, name in enumerate(ACTIONS) if n and n in present]


def _crossed_names(frame: pd.DataFrame) -> list[str]:
    # Returns the columns of parameters, except the action, that differ between runs of one `pair`.
    names = [name for name in frame if name.startswith("param:") and name != ACTION]
    counts = frame[names].groupby(frame["pair"]).nunique(dropna=False)
    return [str(name) for name, count in counts.max().items() if count > 1]


def _parts(pairs: Pairs):
    # Yields the parts of the table: all faults, each layer, each value of a crossed parameter.
    yield "all faults", pairs
    layers = pairs.with_["layer"].to_numpy()
    present = pd.unique(layers)
    if len(present) > 1:
        for layer in present:
            yield str(layer), pairs.where(layers == layer)
    for name in _crossed_names(pd.concat(pairs)):
        values = pairs.with_[name].to_numpy(float)
        different = np.unique(values[~np.isnan(values)])
        if 1 < len(different) <= MOST_VALUES:
            for value in different:
                yield f"{name.removeprefix('param:')} = {value:g}", pairs.where(values == value)


def _difference(
    action: str, among: str, pairs: Pairs, faults: Units | None, inactive: int
) -> Difference:
    # Computes what the reaction changes in these pairs. among, inactive: fields of `Difference`.
    moved_with, moved_without = (part["unintended"].to_numpy() for part in pairs)
    reacted = pairs.with_["reaction_ms"].to_numpy() >= 0
    # Reactions without need: there is no unintended motion without the reaction either.
    needless = ~moved_without[reacted]
    return Difference(
        MEANINGS[action],
        among,
        len(moved_with),
        inactive,
        # The fields from `without` to `p`, in this order.
        *intervals.compare_rates(moved_with, moved_without, faults),
        distance_mm=_mean(pairs, EXCURSION, faults),
        depth_mm=_mean(pairs, "tissue_depth_mm", faults),
        reacted=intervals.pair_rate(reacted, faults),
        idle=intervals.pair_rate(needless, faults.where(reacted) if faults else None),
    )


def _mean(pairs: Pairs, column: str, faults: Units | None) -> Estimate:
    after, before = (part[column].to_numpy(float) for part in pairs)
    return intervals.mean_difference(after, before, faults)


def compare_actions(runs: Runs) -> list[Difference]:
    """Return the comparisons of a campaign; none if it has no pairs."""
    reacts = "reaction" in runs.manifest.shape.stages
    return compare_pairs(runs.once(sample_runs), runs.sampled) if reacts else []


def _content(runs: Runs, _: Path):
    if "reaction" not in runs.manifest.shape.stages:
        return None
    sample, comparisons = runs.once(sample_runs), runs.once(compare_actions)
    return {
        "differences": comparisons,
        "whole": [row for row in comparisons if row.among == "all faults"],
        "interruptions": count_interruptions(sample),
        "reaction_runs": (len(sample), runs.rows),
    }


def _crossed(runs: Runs, _: Path):
    config = runs.manifest.config
    crossed = [table.get("cross", ()) for table in (config, *config.get("group", ()))]
    # Section "Reaction" compares the values of the reaction.
    if all(path.startswith("reaction.") for paths in crossed for path in paths):
        return None
    sample = runs.once(sample_runs)
    return {"crossed": crossed_rows(sample, runs.sampled), "crossed_runs": (len(sample), runs.rows)}


SECTIONS = {"reaction": _content, "crossed": _crossed}
