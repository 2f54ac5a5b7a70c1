"""Writes what a search is and what it found: search.json, search.md, search.html and its
figures.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ravenjax.analyses.search import style
from ravenjax.analyses.search.findings import SearchFindings, TextTable, plain
from ravenjax.document import html
from ravenjax.errors import UserError, listed
from ravenjax.store import files, manifest

NUMBERS, TEXT, PAGE = "search.json", "search.md", "search.html"


def open_folder(out: Path, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Begin a search in `out`, or take it over where it holds the same one: what search.json says
    of the earlier start.

    identity: the part of search.json that decides what comes out. Raises UserError where the folder
    holds another search, and StoreError where it cannot be written to.
    """
    path = out / NUMBERS
    if not path.exists():
        _json(path, dict(identity))
        return {}
    try:
        earlier = files.parsed(path.read_text(encoding="utf-8"))
        differences = manifest.differences(
            {name: earlier[name] for name in identity}, dict(identity)
        )
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(
            f"{path}: cannot be read as a search; delete it, or give another folder with --out"
        ) from None
    if differences:
        raise UserError(
            f"{out}: holds another search, which differs:\n{listed(differences)}\n"
            "Nothing was changed. Give another folder with --out, or delete this one"
        )
    return earlier


def write(out: Path, record: dict[str, Any], findings: SearchFindings) -> None:
    """All files of a search; each is there whole or not at all. Raises StoreError where the disk
    refuses.
    """
    figures = {name: f"{name}.svg" for name in findings.figures}
    for name, draw in findings.figures.items():
        style.save(draw(), out / figures[name])
    text = _markdown(record, findings, figures)
    drawings = {file: (out / file).read_text(encoding="utf-8") for file in figures.values()}
    _text(out / TEXT, text)
    _text(out / PAGE, html.from_markdown(text, drawings))
    _json(out / NUMBERS, record | {"result": findings.numbers})


def _json(path: Path, record: dict[str, Any]) -> None:
    _text(path, json.dumps(plain(record), indent=1, allow_nan=False) + "\n")


def _text(path: Path, text: str) -> None:
    files.write_aside(path, functools.partial(_put, text))


def _put(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")


def _markdown(record: dict[str, Any], findings: SearchFindings, figures: dict[str, str]) -> str:
    campaign = record["config"]["campaign"]
    lines = [f"# Search {campaign['name']}: {record['kind']}", ""]
    if campaign["description"]:
        lines += [campaign["description"], ""]
    lines += [f"- {sentence}" for sentence in findings.sentences]
    lines += [
        (
            f"- {record['runs']} different runs of {campaign['duration_s']:g} s in"
            f" {record['batches']} batches, {_pace(record)}on engine {record['engine']}"
            f" ({record['device']}); seed {record['seed']}."
        ),
        "",
    ]
    for name, file in figures.items():
        lines += [f"![{name}]({file})", ""]
    for table in findings.tables:
        lines += _table(table)
    return "\n".join(lines)


def _pace(record: dict[str, Any]) -> str:
    """How fast, where anything was computed; of an earlier start nobody knows."""
    if not record["runs_per_s"]:
        return ""
    last = (
        "" if record["computed"] == record["runs"] else f" (the last {record['computed']} of them)"
    )
    return f"{record['runs_per_s']:.0f} runs/s{last}, "


def _table(table: TextTable) -> list[str]:
    def row(cells: tuple[str, ...]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    note = [table.note, ""] if table.note else []
    head = [row(table.columns), "|" + "---|" * len(table.columns)]
    return [f"## {table.title}", "", *note, *head, *map(row, table.rows), ""]
