"""Writes what a search found: search.json, search.md, its figures and the runs behind it."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ravenjax.errors import UserError
from ravenjax.search import style
from ravenjax.search.findings import Findings, Table, plain
from ravenjax.store import files

NUMBERS, TEXT, ROWS = "search.json", "search.md", "rows.parquet"


def open_folder(out: Path, identity: Mapping[str, str]) -> None:
    """Make `out`, or take it over where it holds the same search. Raises UserError where it holds another one, and
    StoreError where it cannot be written to.

    identity: the part of search.json that decides what comes out.
    """
    files.require_writable(out)
    path = out / NUMBERS
    if not path.exists():
        return
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        different = [name for name, value in identity.items() if held[name] != value]
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(f"{path}: cannot be read as a search; delete it, or give another folder with --out") from None
    if different:
        told = f"{path} differs in {', '.join(different)}"
        raise UserError(f"{out}: holds another search ({told}). Give another folder with --out, or delete this one")


def write(out: Path, record: dict[str, Any], findings: Findings, rows: pa.Table) -> None:
    """All files of a search; each is there whole or not at all. Raises StoreError where the disk refuses."""
    files.write_aside(out / ROWS, lambda path: pq.write_table(rows, path, compression="zstd"))
    figures = {name: f"{name}.svg" for name in findings.figures}
    for name, draw in findings.figures.items():
        style.save(draw(), out / figures[name])
    _text(out / TEXT, _markdown(record, findings, figures))
    _text(out / NUMBERS, json.dumps(plain(record | {"result": findings.numbers}), indent=1, allow_nan=False) + "\n")


def _text(path: Path, text: str) -> None:
    files.write_aside(path, functools.partial(_put, text))


def _put(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")


def _markdown(record: dict[str, Any], findings: Findings, figures: dict[str, str]) -> str:
    campaign = record["config"]["campaign"]
    lines = [f"# Search {campaign['name']}: {record['kind']}", ""]
    if campaign["description"]:
        lines += [campaign["description"], ""]
    lines += [f"- {sentence}" for sentence in findings.sentences]
    lines += [
        f"- {record['runs']} different runs of {campaign['duration_s']:g} s in {record['batches']} batches, "
        f"{record['runs_per_s']:.0f} runs/s, on engine {record['engine']} ({record['device']}); seed {record['seed']}.",
        "",
    ]
    for name, file in figures.items():
        lines += [f"![{name}]({file})", ""]
    for table in findings.tables:
        lines += _table(table)
    return "\n".join(lines)


def _table(table: Table) -> list[str]:
    def row(cells: tuple[str, ...]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    note = [table.note, ""] if table.note else []
    head = [row(table.columns), "|" + "---|" * len(table.columns)]
    return [f"## {table.title}", "", *note, *head, *map(row, table.rows), ""]
