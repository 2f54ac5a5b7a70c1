"""In how many faults a cable was overloaded, by where they strike."""

from __future__ import annotations

from typing import NamedTuple

from ravenjax.outcomes import events
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import Manifest

ALL = "every site"


class OverloadRow(NamedTuple):
    """Distinct faults of one site, by the first valid run of each in which nobody reacts."""

    site: str
    faults: int
    overloaded: Rate  # those in which a cable was, and none by then in the golden run
    unintended: int  # of the overloaded ones, those with an unintended motion
    cable: str  # the one that was the first to be overloaded most often; "" where none was
    load: float  # largest tension of a cable, by its strength


def rows(runs: Runs, manifest: Manifest) -> list[OverloadRow]:
    """All sites together, then those where a cable was overloaded, the most frequent first; none
    where no tension is known."""
    if not manifest.shape.cables:
        return []
    every = _of(runs, manifest, "''")
    if not every:
        return []
    groups = runs.groups_by("site")
    sites = [
        row._replace(
            overloaded=tables.of_faults(runs, row.overloaded.k, row.faults, groups.get(row.site))
        )
        for row in _of(runs, manifest, "site::VARCHAR")
        if row.overloaded.k
    ]
    return [
        every[0]._replace(site=ALL),
        *sorted(sites, key=lambda row: (-row.overloaded.k, row.site)),
    ]


def _of(runs: Runs, manifest: Manifest, by: str) -> list[OverloadRow]:
    over = events.sql("cable_overload", manifest.rules)
    counts = runs.table.rows(
        f"SELECT {by} AS place, count(*), count(*) FILTER (over), count(*) FILTER (over AND"
        " unintended), coalesce(mode(cable::VARCHAR) FILTER (over), ''), max(load) FROM (SELECT"
        f" row, {over} AS over, cable_overload AS cable, cable_load::DOUBLE AS load FROM {RESULTS})"
        f" JOIN (SELECT row, site, unintended FROM {FACTS} WHERE sample AND faulty) USING (row)"
        " GROUP BY place"
    )
    return [
        OverloadRow(place, n, tables.of_faults(runs, over, n), unintended, cable, load)
        for place, n, over, unintended, cable, load in counts
    ]
