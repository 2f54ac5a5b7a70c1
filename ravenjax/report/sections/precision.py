"""How sharp each rate is, and how many runs a sharper one needs."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.report.data.runs import FaultCounts, Runs
from ravenjax.report.sections import Section, tables
from ravenjax.stats.intervals import Rate
from ravenjax.stats.sample_size.planning import MoreRuns, more_runs

POINTS = (0.03, 0.01)
"""Half-widths asked for, as fractions."""


class PrecisionRow(NamedTuple):
    """The rate of evading faults of one group."""

    group: str
    runs: int
    rate: Rate  # of distinct faults
    half_width: float  # fraction; NaN: no fault has a valid outcome
    within_3: MoreRuns | None  # further distinct faults for +- 3 points; None: not known
    within_1: MoreRuns | None  # for +- 1 point


def rows(runs: Runs) -> list[PrecisionRow]:
    """All faults first, then each group, the widest first; groups that draw their faults alone,
    since a grid has no further faults of its kind. A fault that was run several times counts once.
    """
    groups = [_row(one) for one in runs.faults("group") if runs.sampled([one.name])]
    groups.sort(key=lambda row: -row.half_width if row.rate.n else math.inf)
    if len(groups) < 2 or not runs.sampled():
        return groups
    (together,) = runs.faults()
    return [_row(together._replace(name="all faults")), *groups]


def _row(faults: FaultCounts) -> PrecisionRow:
    rate = tables.rate_of(faults.evaded, faults.faults)
    wide, narrow = (_more(rate.k, rate.n, half) if rate.n else None for half in POINTS)
    half = (rate.high - rate.low) / 2 if rate.n else math.nan
    return PrecisionRow(faults.name, faults.runs, rate, half, wide, narrow)


@functools.lru_cache(maxsize=10_000)
def _more(k: int, n: int, half_width: float) -> MoreRuns:
    """Groups of one size share their few counts."""
    return more_runs(k, n, half_width)


def _content(runs: Runs, _: Path) -> dict[str, Any] | None:
    precision = rows(runs)
    return {"precision": precision} if precision else None


SECTIONS = (Section("precision", "Precision", 180, _content),)
