"""Section "Contact": how hard faults pressed the instruments on tissue, vessel and each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section, tables
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS

ALL = "every fault"
QUANTILES = (0.5, 0.95, 1.0)


class ContactQuantiles(NamedTuple):
    """Quantiles over some faults, in one unit."""

    median: float
    most: float  # 95 % of the faults are at or below this
    largest: float


class ContactRow(NamedTuple):
    """The faults of a group. A fault that was run several times counts once."""

    group: str
    n: int
    harder: Rate  # faults that pressed tissue or vessel harder than their golden run
    peak_n: ContactQuantiles  # N, largest force of tissue and vessel on an instrument
    # N s, that force integrated over the run, summed over instruments.
    impulse_n_s: ContactQuantiles
    vessel: Rate  # faults that pressed the vessel harder than their golden run
    vessel_n: float  # N, the largest force of the vessel
    # Faults that pressed the instruments on each other harder; None for a single arm.
    instruments: Rate | None
    instruments_n: float | None  # N, the largest force between instruments


def rows(runs: Runs) -> list[ContactRow]:
    """Return a row for all faults, then one for each group in the order of their names; no rows
    without contact or without a fault.
    """
    manifest = runs.manifest
    if not manifest.shape.contact:
        return []
    both = len(manifest.shape.arms) > 1
    groups = _of(runs, 'CAST("group" AS VARCHAR)', both)
    if len(groups) == 1:
        return groups
    return [*(row._replace(group=ALL) for row in _of(runs, "''", both)), *groups]


def _of(runs: Runs, by: str, both: bool) -> list[ContactRow]:
    listed = ", ".join(map(str, QUANTILES))
    names = [
        "contact_peak_n",
        "contact_vessel_peak_n",
        *(["contact_instruments_peak_n"] if both else []),
    ]
    more = ", ".join(
        f"count(*) FILTER ({name} > golden_{name}), max({name})::DOUBLE" for name in names
    )
    columns = ", ".join(f"{name}, golden_{name}" for name in names)
    counts = runs.table.rows(
        f"SELECT {by} AS name, count(*), quantile_cont(contact_peak_n::DOUBLE, [{listed}]), "
        f'quantile_cont(contact_impulse_n_s::DOUBLE, [{listed}]), list(DISTINCT "group"), {more} '
        f"FROM (SELECT row, contact_impulse_n_s, {columns} FROM {RESULTS}) "
        f'JOIN (SELECT row, "group"::VARCHAR AS "group" FROM {FACTS} WHERE sample AND faulty) USING'
        " (row) "
        "GROUP BY name ORDER BY name"
    )
    out = []
    for name, n, peak, impulse, groups, harder, _, vessel, vessel_n, *instruments in counts:
        met = tables.of_faults(runs, instruments[0], n, groups) if both else None
        pressed, of_vessel = (tables.of_faults(runs, k, n, groups) for k in (harder, vessel))
        strongest = instruments[1] if both else None
        quantiles = ContactQuantiles(*peak), ContactQuantiles(*impulse)
        out.append(ContactRow(name, n, pressed, *quantiles, of_vessel, vessel_n, met, strongest))
    return out


def _content(runs: Runs, _: Path) -> dict[str, Any] | None:
    contacts = rows(runs)
    return {"contacts": contacts} if contacts else None


SECTIONS = (Section("contact", "Contact", 130, _content),)
