"""Traces each hazard to its runs, and each run to the part of the result that holds it."""

import bisect
import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from evidence.sources import Source
from ravenjax.outcomes import verdict
from ravenjax.report import wording
from ravenjax.report.data.facts import FACTS
from ravenjax.store.access.query import RESULTS, quote_name

COLUMNS = (
    "result",
    "campaign",
    "hazard",
    "group",
    "run_id",
    "index",
    "fault",
    "response",
    "response_cause",
    "cue",
    "evades",
    "in_rates",
    "hazard_ms",
    "told_ms",
    "part",
    "part_sha256",
)
"""Columns of the trace. `in_rates`: the run counts for its fault in every rate. Other runs repeat
it or have a reaction.
"""
BATCH = 20_000
"""Rows that are read together. Each becomes Python objects."""
TRACED = tuple(name for name in verdict.HAZARDS if name != "none")


def count_matrix(sources: Sequence[Source]) -> Iterator[dict[str, Any]]:
    """Return one line per group with faults: how many distinct faults ended in each hazard. The
    trace has their runs.
    """
    for source in sources:
        cube = source.runs.cube()
        mine = cube.loc[cube["faulty"] & cube["sample"]]
        for group, part in mine.groupby("group"):
            counts = part.groupby("hazard")["runs"].sum()
            yield {
                "result": source.name,
                "campaign": source.record.campaign,
                "group": group,
                "faults": int(part["runs"].sum()),
                **{name.replace(" ", "_"): int(counts.get(name, 0)) for name in verdict.HAZARDS},
                "evade": int(part.loc[part["evaded"], "runs"].sum()),
            }


def write_trace(path: Path, sources: Sequence[Source]) -> None:
    """Write every valid run with a fault and a hazard, one line per run, by result and hazard, in
    batches.
    """
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for source in sources:
            for hazard in TRACED:
                writer.writerows(_lines(source, hazard))


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
            yield [
                source.name,
                record.campaign,
                hazard,
                row["group"],
                row["run_id"],
                row["row"],
                wording.describe_fault(row, record.robot),
                row["response"],
                row["cause"],
                _yes(row["cued"]),
                _yes(row["evaded"]),
                _yes(row["sample"]),
                row["hazard_ms"] if row["hazard_ms"] >= 0 else "",
                row["told_ms"] if row["told_ms"] >= 0 else "",
                part.file,
                part.sha256,
            ]


def _yes(value: bool) -> str:
    return "yes" if value else "no"
