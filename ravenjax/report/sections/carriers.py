"""Which signals carry the faults that evade the checks, and where those were visible first: over
explained runs.

A signal *carries* a run where it differs from the golden run when harm begins, or before. It
*shows* the run where it leaves its normal range before harm; its lead is the time from there to
harm. Both arms' signals of one seam count as one. Runs are one of each fault, as in every rate of
the report, and of groups whose evading faults are all explained.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.run import chain
from ravenjax.report.sections import robots
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate, share, wilson
from ravenjax.store.access.query import RESULTS, quoted
from ravenjax.store.manifest import Manifest

CHOSEN = "sample AND faulty AND evaded AND unintended_ms >= 0"
_NEVER = 2**62


class Carrier(NamedTuple):
    """One seam, over the runs of a `Propagation`."""

    seam: str
    layer: str
    meaning: str
    ranged: bool  # whether it has a normal range
    carries: Rate
    shows: Rate
    lead_ms: Estimate  # median over the runs that it shows; NaN: none
    first: Rate  # runs in which it was the first of all to show, in the robot's order within a tick


class Passage(NamedTuple):
    """One seam after the other, in the order in which they begin to differ."""

    before: str
    after: str
    rate: Rate


class Propagation(NamedTuple):
    """How the evading faults of a campaign came about."""

    runs: int  # explained evading faults that are looked at
    evading: int  # of the campaign
    groups: Sequence[str]  # whose evading faults are all explained
    partial: Sequence[str]  # of whose only some are, or none
    counted: str  # what intervals count: "faults", "robots", or "" where there are none
    carriers: Sequence[Carrier]  # in the robot's order; those that carry a run
    passages: Sequence[Passage]  # the most frequent first
    hidden: Rate  # runs that no signal showed before harm
    lead_ms: Estimate  # median, from the first signal that shows to harm

    @property
    def first_places(self) -> list[Carrier]:
        """Where runs were visible first, most of them first."""
        return sorted((one for one in self.carriers if one.first.k), key=lambda one: -one.first.k)


def propagation(runs: Runs, ticks: pd.DataFrame) -> Propagation:
    """Of the explained runs `ticks`, as `store.access.explained` has them."""
    whole_robots = robots.drawn_whole(runs)
    among = f"hash({', '.join(map(quoted, whole_robots))})" if whole_robots else "row"
    facts = runs.table.frame(
        f'SELECT row, "group"::VARCHAR AS "group", unintended_ms AS harm, unit FROM {FACTS} '
        f"JOIN (SELECT row, {among} AS unit FROM {RESULTS}) USING (row) WHERE {CHOSEN} ORDER BY row"
    )
    there = facts["row"].isin(ticks["index"])
    lacking = set(facts.loc[~there, "group"])
    whole = sorted(set(facts["group"]) - lacking)
    mine = facts.loc[facts["group"].isin(whole)].reset_index(drop=True)
    rows = ticks.set_index("index").loc[mine["row"]]
    counting = _Counting.of(mine, bool(whole_robots), bool(len(mine)) and runs.sampled(whole))
    harm = mine["harm"].to_numpy(np.int64)
    seams = _seams(rows, runs.manifest)
    leads = _leads(seams, harm)
    best = leads.max(axis=0, initial=-1)  # the earliest to show has the longest lead
    firsts = leads.argmax(axis=0) if len(seams) else np.zeros(len(mine), int)
    carriers = [
        Carrier(
            one.name,
            one.layer,
            one.meaning,
            one.ranged,
            counting.rate(_by(one.differs, harm)),
            counting.rate(leads[place] > 0),
            counting.median(leads[place], leads[place] > 0),
            counting.rate((firsts == place) & (best > 0)),
        )
        for place, one in enumerate(seams)
    ]
    return Propagation(
        len(mine),
        len(facts),
        whole,
        sorted(lacking),
        counting.noun,
        [one for one in carriers if one.carries.k],
        _passages(seams, harm, counting),
        counting.rate(best <= 0),
        counting.median(best, best > 0),
    )


def _seams(rows: pd.DataFrame, manifest: Manifest) -> list[chain.SignalTicks]:
    """Signals of both arms as one, in the robot's order; their channels are left out."""
    columns = {str(name): rows[name].to_numpy() for name in rows}
    by_seam: dict[str, list[chain.SignalTicks]] = {}
    for one in chain.signals(columns, manifest.robot, manifest.shape.arms) if len(rows) else ():
        by_seam.setdefault(one.name.rpartition("/")[2], []).append(one)
    return [
        arms[0]._replace(
            name=name,
            differs=chain.earliest(np.stack([one.differs for one in arms])),
            leaves=chain.earliest(np.stack([one.leaves for one in arms])),
        )
        for name, arms in by_seam.items()
    ]


def _by(ticks: np.ndarray, harm: np.ndarray) -> np.ndarray:
    """Whether something came until harm, bool [runs]."""
    return (ticks >= 0) & (ticks <= harm)


def _leads(seams: Sequence[chain.SignalTicks], harm: np.ndarray) -> np.ndarray:
    """How long before harm each seam showed each run, ms [seams, runs]; 0: not before it."""
    if not seams:
        return np.zeros((0, len(harm)), np.int64)
    return np.stack(
        [np.where((one.leaves >= 0) & (one.leaves < harm), harm - one.leaves, 0) for one in seams]
    )


def _passages(
    seams: Sequence[chain.SignalTicks], harm: np.ndarray, counting: _Counting
) -> list[Passage]:
    """Every pair of seams of which one is the next to differ after the other in some run."""
    if not seams or not len(harm):
        return []
    times = np.stack(
        [np.where(_by(one.differs, harm), one.differs.astype(np.int64), _NEVER) for one in seams]
    )
    order = np.argsort(times, axis=0, kind="stable")  # within a tick in the robot's order
    came = np.take_along_axis(times, order, axis=0) < _NEVER
    pairs: dict[tuple[int, int], np.ndarray] = {}
    for before, after, there in zip(order[:-1], order[1:], came[1:], strict=True):
        for code in np.unique(before[there] * len(seams) + after[there]).tolist():
            pair = divmod(code, len(seams))
            hit = there & (before == pair[0]) & (after == pair[1])
            pairs[pair] = pairs.get(pair, np.zeros(len(harm), bool)) | hit
    rows = [
        Passage(seams[a].name, seams[b].name, counting.rate(hit)) for (a, b), hit in pairs.items()
    ]
    return sorted(rows, key=lambda row: (-row.rate.k, row.before, row.after))


class _Counting(NamedTuple):
    """How rates and medians get their intervals."""

    among: Units | None  # faults by group, or robots; None: nothing was sampled
    each: bool  # a unit a run
    noun: str

    @staticmethod
    def of(rows: pd.DataFrame, robots: bool, sampled: bool) -> _Counting:
        """rows: unit and group of each run; robots: units are robots that were drawn whole, in
        every group alike.
        """
        if not sampled and not robots:
            return _Counting(None, False, "")
        if robots:
            among = units.units(rows["unit"].to_numpy())
        else:
            among = units.units(rows["unit"].to_numpy(), rows["group"].to_numpy())
        return _Counting(among, not robots, "robots" if robots else "faults")

    def rate(self, hit: np.ndarray) -> Rate:
        """Share of runs: Wilson's where each is a fault of its own, else by resampling robots."""
        k, n = int(hit.sum()), len(hit)
        if self.among is None:
            return share(k, n)
        return wilson(k, n) if self.each else units.rate(hit, self.among)

    def median(self, values: np.ndarray, chosen: np.ndarray) -> Estimate:
        """Median of the chosen runs, by resampling units; NaN without any."""
        some = values[chosen].astype(float)
        if not len(some):
            return Estimate(math.nan, math.nan, math.nan)
        if self.among is None:
            return Estimate(float(_median(some)(np.ones((1, len(some))))[0]), math.nan, math.nan)
        return units.statistic(_median(some), self.among.where(chosen))


def _median(values: np.ndarray) -> Any:
    """The value with half of the weight on either side, between two where both have it; of
    weights [b, n].
    """
    order = np.argsort(values, kind="stable")
    in_order = values[order]

    def of(weight: np.ndarray) -> np.ndarray:
        heap = np.cumsum(weight[:, order], axis=1)
        half = heap[:, -1:] / 2
        below, until = ((heap < half).sum(axis=1), (heap <= half).sum(axis=1))
        return (
            in_order[below.clip(max=len(values) - 1)] + in_order[until.clip(max=len(values) - 1)]
        ) / 2

    return of
