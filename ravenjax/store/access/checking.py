"""What a result folder must hold to be believed: whole parts, each row once, values that a run can
have.

Each check is one line of a table: what was looked at, and each thing that is wrong in words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq

from ravenjax import threads
from ravenjax.errors import StoreError
from ravenjax.outcomes import events, verdict
from ravenjax.store import parts, schema
from ravenjax.store.access import query
from ravenjax.store.access.query import ResultTable, quoted, text
from ravenjax.store.folder import PARTS, READERS
from ravenjax.store.manifest import Manifest
from ravenjax.vocabulary import failures

MOST = 5
"""Problems of one check that are told, and columns in one of them."""
MAY_BE_NAN = ("_value", "tip_distance_mm")
"""Ends of names of those that are NaN where there is no such number; varied parameters are, too."""


class FolderCheck(NamedTuple):
    """One thing that was looked at."""

    name: str
    looked_at: str  # how much of it, in words
    problems: list[str]  # none: as it must be

    @property
    def fine(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def files(folder: Path, record: Manifest) -> tuple[FolderCheck, list[parts.Part]]:
    """That every recorded part is to the byte what was recorded, and that there is no other; and
    the whole ones.
    """
    there = {path.name for path in parts.files(folder / PARTS)}
    stray = sorted(there - {part.file for part in record.parts})

    def problem(part: parts.Part) -> str:
        path = folder / PARTS / part.file
        try:
            parts.verify(path, record.config_hash, part)
            return _differs(path, part, record.shape)
        except StoreError as error:
            return str(error)

    problems = threads.mapped(problem, record.parts, READERS)
    complaints = [
        *filter(None, problems),
        *(f"{folder / PARTS / name}: no record names this part" for name in stray),
    ]
    size = sum(part.size for part in record.parts)
    number = "1 part" if len(record.parts) == 1 else f"{len(record.parts):,} parts"
    looked_at = f"{number}, {size / 1e6:,.1f} MB: checksum, schema, campaign"
    whole = [part for part, complaint in zip(record.parts, problems, strict=True) if not complaint]
    return FolderCheck("parts", looked_at, _short(complaints)), whole


def rows(record: Manifest) -> FolderCheck:
    """That the recorded parts hold each row that they are to hold, and none twice."""
    complaints = [
        f"{part.file}: holds rows that another part holds, too"
        for part in parts.apart(record.parts)[1]
    ]
    missing = query.lacking(record.wanted, record.parts)
    if missing:
        complaints.append(f"{sum(map(len, missing)):,} rows are missing: {query.in_words(missing)}")
    elif record.finished is None:
        complaints.append("every row is there, but no start of the command ended: start it again")
    beyond = [
        part
        for part in record.parts
        if not any(r.start <= part.first and part.last < r.stop for r in record.wanted)
    ]
    complaints += [f"{part.file}: holds rows that are not asked of this folder" for part in beyond]
    return FolderCheck("rows", f"{record.done:,} of {record.due:,} rows", _short(complaints))


def values(folder: Path, record: Manifest, whole: list[parts.Part]) -> list[FolderCheck]:
    """That the rows of whole parts have values that a run can have: one pass over the table for
    each check.
    """
    if not whole:
        return []
    with query.open_parts(
        [folder / PARTS / part.file for part in whole], folder, numbered=True
    ) as table:
        checks = [
            ("row numbers", _numbers),
            ("ranges", _ranges),
            ("finite numbers", _finite),
            ("verdicts", _verdicts),
        ]
        return [_check(table, record, name, conditions) for name, conditions in checks]


def _check(
    table: ResultTable,
    record: Manifest,
    name: str,
    conditions: Callable[[Manifest], Iterator[tuple[str, str, str]]],
) -> FolderCheck:
    """Count the rows that break each of the conditions: (column, condition that must hold, what
    is wrong else).
    """
    rules = list(conditions(record))
    counted = [f"count(*) FILTER (NOT coalesce({must}, false))" for _, must, _ in rules]
    _, *broken = table.row(f"SELECT count(*), {', '.join(counted)} FROM {query.RESULTS}")
    complaints = []
    for (column, must, complaint), n in zip(rules, broken, strict=True):
        if n:
            ((first,),) = table.rows(
                f'SELECT min("index") FROM {query.RESULTS} WHERE NOT coalesce({must}, false)'
            )
            complaints.append(
                f"{column}: {complaint} in {n:,} row{'s' if n > 1 else ''}, the first is {first}"
            )
    return FolderCheck(
        name, f"{len(rules)} columns or rules in {record.done:,} rows", _short(complaints)
    )


def _numbers(record: Manifest) -> Iterator[tuple[str, str, str]]:
    first = "regexp_extract(parse_filename(filename), 'part-(\\d+)-', 1)::BIGINT"
    yield (
        "index",
        f'"index" = {first} + file_row_number',
        "does not count up from the part's first row",
    )
    yield "run_id", "regexp_full_match(run_id, '[0-9a-f]{16}')", "is not 16 hex digits"
    yield "pair", f"pair BETWEEN 0 AND {record.runs - 1}", "is no row of the campaign"


def _ranges(record: Manifest) -> Iterator[tuple[str, str, str]]:
    for column in schema.columns(record.shape):
        name, end = quoted(column.name), record.duration_ms
        if column.name.startswith("fault") or not column.dtype.startswith("int"):
            continue
        if column.name.endswith(
            ("_first_ms", "_last_ms", "_active_ms", "response_ms", "reaction_ms", "told_ms")
        ):
            yield column.name, f"{name} BETWEEN -1 AND {end}", f"lies outside -1 to {end} ms"
        elif column.unit in ("ms", "ticks"):
            yield (
                column.name,
                f"{name} BETWEEN 0 AND {end}",
                f"lies outside 0 to {end} {column.unit}",
            )
        elif column.name == "end_runlevel":
            yield column.name, f"{name} BETWEEN -1 AND 3", "is no run level"
        elif column.unit == "DAC counts" or column.name.endswith(("_count", "_alarms")):
            yield column.name, f"{name} >= 0", "is negative"
    known_words = {
        "response": verdict.RESPONSES,
        "hazard": verdict.HAZARDS,
        "failed": failures.CAUSES,
        "verdict": (*verdict.VERDICTS, ""),
    }
    for name, words in known_words.items():
        yield (
            name,
            f"{name} IN ({', '.join(map(text, words))})",
            "is none of the words that it can be",
        )


def _finite(record: Manifest) -> Iterator[tuple[str, str, str]]:
    for column in schema.columns(record.shape):
        name = quoted(column.name)
        if not column.dtype.startswith("float") or column.name.startswith("param:"):
            continue
        valid = f"failed <> '' OR NOT isnan({name})"
        if column.name.endswith(schema.MAY_BE_INFINITE):
            yield column.name, valid, "is not a number"
        elif column.name.endswith(MAY_BE_NAN):
            yield column.name, f"NOT isinf({name})", "is infinite"
        else:
            yield column.name, f"failed <> '' OR isfinite({name})", "is not finite"


def _verdicts(record: Manifest) -> Iterator[tuple[str, str, str]]:
    cue = f"CASE WHEN {events.sql('cue', record.rules)} THEN 'cue' ELSE 'no cue' END"
    follows = f"CASE WHEN failed <> '' THEN '' ELSE response || '/' || hazard || '/' || {cue} END"
    yield "verdict", f"verdict = {follows}", "does not follow from response, hazard and cue"
    halted = f"response <> 'stopped' AND halted_ms - golden_halted_ms > {verdict.HALT_MS}"
    hazard = (
        "CASE WHEN unintended_first_ms >= 0 THEN 'unintended motion' "
        f"WHEN loss_first_ms >= 0 OR ({halted}) THEN 'loss of motion' "
        "WHEN false_report_first_ms >= 0 THEN 'false report' ELSE 'none' END"
    )
    yield "hazard", f"hazard = {hazard}", "does not follow from the times of the hazards"
    yield "told_ms", f"(told_ms >= 0) = ({events.TOLD_SQL})", "does not follow from response"
    yield "failed_first_ms", "(failed = '') = (failed_first_ms < 0)", "does not follow from failed"
    yield "activated", "activated = (active_ticks > 0)", "does not follow from active_ticks"
    for rule in ("code", "text", "tip"):
        yield (
            f"jump_{rule}",
            f"jump_{rule} = (jump_{rule}_first_ms >= 0)",
            f"does not follow from jump_{rule}_first_ms",
        )


def _differs(path: Path, part: parts.Part, shape: schema.Shape) -> str:
    """How columns and number of rows of a part differ from those that it must have, "" if they
    do not.
    """
    footer = pq.read_metadata(path)
    if footer.num_rows != len(part.rows):
        return f"{path}: holds {footer.num_rows} rows, its name says {part.first} to {part.last}"
    wanted, actual = schema.arrow_schema(shape), footer.schema.to_arrow_schema()
    if actual.equals(wanted):
        return ""
    odd = [
        name
        for name in wanted.names
        if name not in actual.names or actual.field(name) != wanted.field(name)
    ]
    odd += [name for name in actual.names if name not in wanted.names]
    return (
        f"{path}: has other columns than its campaign:"
        f" {', '.join(odd[:MOST]) or 'in another order'}"
    )


def _short(problems: list[str]) -> list[str]:
    more = [f"and {len(problems) - MOST} more"] if len(problems) > MOST else []
    return problems[:MOST] + more
