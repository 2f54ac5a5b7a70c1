"""Writes the trace tables of a risk file: the runs of each hazard, and the result file that
contains each run.
"""

import bisect
import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from evidence.sources import Source
from ravenjax.outcomes import verdict
from ravenjax.report import wording
from ravenjax.report.data.facts import FACTS
from ravenjax.store.access.query import RESULTS, quote_name
from ravenjax.store.files import without_formula

COLUMNS = (
    *("result", "campaign", "hazard", "group", "run_id", "index", "fault", "response"),
    *("response_cause", "cue", "evades", "in_rates", "hazard_ms", "told_ms", "part", "part_sha256"),
)
"""Columns of the trace. `in_rates`: the run counts for its fault in every rate. Other runs repeat
it or have a reaction.
"""
BATCH = 20_000
"""Rows that are read together. Each becomes Python objects."""
TRACED = tuple(name for name in verdict.HAZARDS if name != "none")


def count_matrix(source: Source) -> pd.DataFrame:
    """Return one line per group with faults: how many distinct faults ended in each hazard. The
    trace has their runs.
    """
    cube = source.runs.cube
    counted = cube.loc[cube["faulty"] & cube["sample"]].astype({"group": str, "hazard": str})
    by_hazard = counted.pivot_table("runs", "group", "hazard", "sum", 0)
    matrix = by_hazard.reindex(columns=list(verdict.HAZARDS), fill_value=0)
    matrix.columns = [name.replace(" ", "_") for name in matrix]
    matrix.insert(0, "faults", matrix.sum(axis=1))
    evading = counted[counted["evaded"]].groupby("group")["runs"].sum()
    matrix["evade"] = evading.reindex(matrix.index, fill_value=0)
    names = pd.DataFrame({"result": source.name, "campaign": source.record.campaign}, matrix.index)
    return names.join(matrix.reset_index().set_index("group", drop=False))


def write_trace(path: Path, sources: Sequence[Source]) -> None:
    """Write every valid run with a fault and a hazard, one line per run, by result and hazard, in
    batches.
    """
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for source in sources:
            for hazard in TRACED:
                lines = _lines(source, hazard)
                writer.writerows(map(without_formula, line) for line in lines)


def _lines(source: Source, hazard: str) -> Iterator[list[Any]]:
    runs, record = source.runs, source.record
    slots = [name for name in runs.names if name.startswith("fault")]
    query = (
        'SELECT f.row, r.run_id, f."group"::VARCHAR AS "group", f.response::VARCHAR AS response, '
        "r.response_cause::VARCHAR AS cause, f.cued, f.evaded, f.sample, f.told_ms, "
        "greatest(f.unintended_ms, f.loss_ms, f.misreport_ms) AS hazard_ms, "
        f"{', '.join(f'r.{quote_name(name)}' for name in slots)} FROM {RESULTS} r JOIN {FACTS} f ON"
        " r.row = f.row "
        f"WHERE f.faulty AND NOT f.failed AND f.hazard = '{hazard}' ORDER BY f.row"
    )
    ordered = sorted(record.parts, key=lambda part: part.first)
    starts = [part.first for part in ordered]
    for batch in runs.table.batches(query, BATCH):
        for row in batch.to_pylist():
            part = ordered[bisect.bisect_right(starts, row["row"]) - 1]
            fault = wording.describe_fault(row, record.robot)
            yield [
                *(source.name, record.campaign, hazard, row["group"], row["run_id"], row["row"]),
                *(fault, row["response"], row["cause"]),
                *("yes" if row[name] else "no" for name in ("cued", "evaded", "sample")),
                *(row[name] if row[name] >= 0 else "" for name in ("hazard_ms", "told_ms")),
                *(part.file, part.sha256),
            ]
