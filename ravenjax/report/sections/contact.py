"""Section "Contact": how hard faults pressed the instruments on tissue, vessel and each other."""

from typing import NamedTuple

from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.report.sections.tables import Quantiles
from ravenjax.stats.intervals import Rate

ALL_FAULTS = "every fault"


class ContactRow(NamedTuple):
    """The faults of a group. A fault that was run several times counts once."""

    group: str
    n: int
    peak_n: Quantiles  # N, largest force of tissue and vessel on an instrument
    impulse_n_s: Quantiles  # N s, that force integrated over the run, summed over instruments
    harder: Rate  # faults that pressed tissue or vessel harder than their golden run
    vessel: Rate  # faults that pressed the vessel harder than their golden run
    vessel_n: float  # N, the largest force of the vessel
    # Faults that pressed the instruments on each other harder; None for a single arm.
    instruments: Rate | None = None
    instruments_n: float | None = None  # N, the largest force between instruments


def contact_rows(runs: Runs) -> list[ContactRow]:
    """Return a row for all faults, then one for each group; none without contact or faults."""
    if "contact" not in runs.manifest.shape.stages:
        return []
    groups = _rows_by(runs, f'{FACTS}."group"::VARCHAR')
    if len(groups) == 1:
        return groups
    return [*_rows_by(runs, f"'{ALL_FAULTS}'"), *groups]


def _rows_by(runs: Runs, by: str) -> list[ContactRow]:
    # Returns a row for each value of `by` (SQL), over all distinct faults.
    names = ["contact_peak_n", "contact_vessel_peak_n"]
    # Instruments can touch each other only if there are two.
    if len(runs.manifest.shape.arms) > 1:
        names.append("contact_instruments_peak_n")
    columns = (
        tables.quantiles_sql(names[0]),
        tables.quantiles_sql("contact_impulse_n_s"),
        *(f"count(*) FILTER ({name} > golden_{name}), max({name})::DOUBLE" for name in names),
    )
    rows = []
    for name, groups, n, peak, impulse, *numbers in tables.class_counts(runs, by, columns):
        # For each force: faults in which it exceeds the golden run's, and the largest force in N.
        counts, forces_n = numbers[::2], numbers[1::2]
        harder, vessel, *instruments = (tables.fault_share(runs, k, n, groups) for k in counts)
        sizes = Quantiles(*peak), Quantiles(*impulse)
        _, vessel_n, *instruments_n = forces_n
        row = ContactRow(name, n, *sizes, harder, vessel, vessel_n)
        if instruments:
            row = row._replace(instruments=instruments[0], instruments_n=instruments_n[0])
        rows.append(row)
    return rows


SECTIONS = {"contact": lambda runs, _: {"contacts": row} if (row := contact_rows(runs)) else None}
