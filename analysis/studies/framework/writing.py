"""A study's files: findings as JSON, Markdown and HTML, each drawing as SVG and PDF; the same
findings give the same bytes."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ravenjax.document import html
from ravenjax.errors import StoreError
from ravenjax.store.files import parsed, require_writable, write_aside
from studies.framework import credibility, drawing, markdown
from studies.framework.provenance import Provenance
from studies.framework.study import Findings, Study, plain

JSON, PAGE, HTML = "findings.json", "findings.md", "findings.html"


def write(study: Study, findings: Findings, made: Provenance, folder: Path) -> None:
    """Write all files of these findings into `folder`. Raises StoreError where the disk refuses."""
    require_writable(folder)
    record = _record(study, findings, made)
    for one in findings.drawings:
        drawing.save(one, folder)
    text = markdown.page(record, pictures=True)
    drawings = {
        name: (folder / name).read_text(encoding="utf-8")
        for name in (f"{d.name}.svg" for d in findings.drawings)
    }
    _write(folder / PAGE, text)
    _write(folder / HTML, html.from_markdown(text, drawings))
    _write(folder / JSON, _json(record))


def keep(source: Path, target: Path) -> Path:
    """Copy the findings in folder `source` into folder `target`, without pictures. Raises
    StoreError.

    Both files hold neither times nor places: the same engine on the same device gives the same
    bytes.
    """
    record = read(source)
    require_writable(target)
    _write(target / PAGE, markdown.page(record, pictures=False))
    _write(target / JSON, _json(record))
    return target


def read(folder: Path) -> dict[str, Any]:
    """The record of findings that a folder holds. Raises StoreError."""
    try:
        return parsed((folder / JSON).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StoreError(
            f"{folder / JSON}: no findings there ({error}); run `ravenjax reproduce` first"
        ) from None


def records(folder: Path, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Those of the studies that the folder holds, in the order of `names`. Raises StoreError."""
    return {name: read(folder / name) for name in names if (folder / name / JSON).is_file()}


def write_credibility(folder: Path, names: Iterable[str]) -> Path:
    """Write the page over the studies that the folder holds. Raises StoreError where the disk
    refuses.
    """
    path = folder / credibility.NAME
    _write(path, credibility.page(records(folder, names)))
    return path


def _record(study: Study, findings: Findings, made: Provenance) -> dict[str, Any]:
    about = {
        name: plain(getattr(study, name))
        for name in ("name", "title", "source", "question", "targets")
    }
    drawings = [{"name": one.name, "caption": one.caption} for one in findings.drawings]
    return {"study": about, **plain(findings), "drawings": drawings, "provenance": made.as_json()}


def _json(record: dict[str, Any]) -> str:
    return json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _write(path: Path, text: str) -> None:
    write_aside(path, lambda target: target.write_bytes(text.encode()))
