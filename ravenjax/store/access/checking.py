"""Checks a result folder: its files are complete, each run occurs once, and values are plausible.

Each check is one row of the printed table: what was checked, and the errors that were found.
"""

import re
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq

from ravenjax import resources, threads
from ravenjax.errors import StoreError
from ravenjax.outcomes import events, verdict
from ravenjax.store import parts, schema
from ravenjax.store.access import query
from ravenjax.store.access.query import ResultTable, quote_name, quote_text
from ravenjax.store.folder import PARTS, READERS
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary import failures

MOST = 5
"""Largest number of printed problems of a check, and of columns that a problem names."""
WORDS = {
    "response": verdict.RESPONSES,
    "hazard": verdict.HAZARDS,
    "failed": failures.CAUSES,
    "verdict": (*verdict.VERDICTS, ""),
}
"""Columns of words, and the possible words of each."""


class FolderCheck(NamedTuple):
    """Result of one check of a result folder."""

    name: str
    looked_at: str  # what was checked, as text
    problems: list[str]  # the errors that were found

    @property
    def fine(self) -> bool:
        """Whether no problem was found."""
        return not self.problems


def check_files(folder: Path, record: Manifest) -> tuple[FolderCheck, list[parts.Part]]:
    """Check that the files of results have their recorded content, and that there are no others.
    Also return the records of complete files.
    """
    there = {path.name for path in parts.part_files(folder / PARTS)}
    stray = sorted(there - {part.file for part in record.parts})

    def problem(part: parts.Part) -> str:
        # Returns what is wrong with a part, "" if nothing is.
        path = folder / PARTS / part.file
        try:
            parts.verify_part(path, record.config_hash, part)
            return _differs(path, part, record.shape)
        except StoreError as error:
            return str(error)

    problems = threads.map_in_threads(problem, record.parts, READERS)
    complaints = [
        *filter(None, problems),
        *(f"{folder / PARTS / name}: the manifest does not list this file" for name in stray),
    ]
    size = sum(part.size for part in record.parts)
    number = "1 part" if len(record.parts) == 1 else f"{len(record.parts):,} parts"
    looked_at = f"{number}, {size / 1e6:,.1f} MB: checksum, schema, campaign"
    whole = [part for part, complaint in zip(record.parts, problems, strict=True) if not complaint]
    return FolderCheck("parts", looked_at, _short(complaints)), whole


def check_rows(record: Manifest) -> FolderCheck:
    """Check that the files contain each row that they should contain, and no row twice."""
    _, overlapping = parts.without_overlaps(record.parts)
    complaints = [
        f"{part.file}: contains runs that another file contains, too" for part in overlapping
    ]
    missing = list(parts.missing_rows(record.parts, record.wanted))
    if missing:
        complaints.append(f"{sum(map(len, missing)):,} rows are missing: {query.in_words(missing)}")
    elif record.finished is None:
        complaints.append("all runs are stored, but the command was interrupted: start it again")
    complaints += [
        f"{part.file}: contains runs that do not belong in this folder"
        for part in record.parts
        if not any(part.first in rows and part.last in rows for rows in record.wanted)
    ]
    return FolderCheck("rows", f"{record.done:,} of {record.due:,} rows", _short(complaints))


def check_values(folder: Path, record: Manifest, whole: list[parts.Part]) -> list[FolderCheck]:
    """Check the values in the complete files `whole` with the rules for values in rules.toml."""
    if not whole:
        return []
    files = [folder / PARTS / part.file for part in whole]
    with query.open_parts(files, folder, numbered=True) as table:
        rules = resources.read_tables(__file__, "rules.toml")
        return [_check(table, record, check, listed) for check, listed in rules.items()]


def _check(table: ResultTable, record: Manifest, check: str, rules: list[dict]) -> FolderCheck:
    # Checks all columns in one query, each with the first rule whose pattern fits its name, type
    # and unit. A rule has an SQL condition ("must") and a message, or else exempts its columns.
    musts, complaints = [], []
    for column in schema.table_columns(record.shape):
        field = f"{column.name} {column.dtype} {column.unit}"
        rule = next((one for one in rules if re.fullmatch(one["columns"], field)), {})
        if "must" in rule:
            terms = {
                "name": quote_name(column.name),
                "column": column,
                "words": ", ".join(map(quote_text, WORDS.get(column.name, ()))),
                "end": record.duration_ms,
                "last_row": record.runs - 1,
                "cue": events.event_sql("cue", record.rules),
                "told": events.TOLD_SQL,
                "halt_ms": verdict.HALT_MS,
            }
            musts.append(f"coalesce({rule['must'].format(**terms)}, false)")
            complaints.append(f"{column.name}: {rule['complaint'].format(**terms)}")
    counted = (f"count(*) FILTER (NOT {must})" for must in musts)
    counts = table.row(f"SELECT {', '.join(counted)} FROM {query.RESULTS}")
    problems = []
    for must, complaint, n in zip(musts, complaints, counts, strict=True):
        if n:
            (first,) = table.row(f'SELECT min("index") FROM {query.RESULTS} WHERE NOT {must}')
            problems.append(f"{complaint} in {n:,} run{'s' if n > 1 else ''}, first in run {first}")
    looked_at = f"{len(musts)} columns in {record.done:,} rows"
    return FolderCheck(check, looked_at, _short(problems))


def _differs(path: Path, part: parts.Part, shape: schema.Shape) -> str:
    """Return how the columns or the rows of a file differ from the expected ones, or ""."""
    footer = pq.read_metadata(path)
    if footer.num_rows != len(part.rows):
        return f"{path}: contains {footer.num_rows} rows, expected rows {part.first} to {part.last}"
    wanted, actual = schema.arrow_schema(shape), footer.schema.to_arrow_schema()
    if actual.equals(wanted):
        return ""
    differing = sorted({field.name for field in {*wanted} ^ {*actual}})
    names = ", ".join(differing[:MOST]) or "in another order"
    return f"{path}: has other columns than its campaign: {names}"


def _short(problems: list[str]) -> list[str]:
    more = [f"and {len(problems) - MOST} more"] if len(problems) > MOST else []
    return problems[:MOST] + more
