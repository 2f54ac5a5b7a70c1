"""Writes a search and its result: search.json, search.md, search.html and the figure."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses import panels
from ravenjax.analyses.search.wording import (
    describe_case,
    describe_inputs,
    format_number,
    group_series,
    short_axis_name,
)
from ravenjax.document import html
from ravenjax.document.chart import Chart
from ravenjax.errors import UserError, list_lines
from ravenjax.report import wording
from ravenjax.store import files, manifest

NUMBERS, TEXT, PAGE = "search.json", "search.md", "search.html"


def open_folder(out: Path, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Begin a search in `out`, or continue it, and return what search.json says of the earlier
    start.

    `identity`: the part of search.json that decides the result. Raises UserError if the folder
    holds another search, and StoreError if it cannot be written to.
    """
    path = out / NUMBERS
    if not path.exists():
        _json(path, dict(identity))
        return {}
    try:
        earlier = files.parse_json(path.read_text(encoding="utf-8"))
        differences = manifest.find_differences(
            {name: earlier[name] for name in identity}, dict(identity)
        )
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(
            f"{path}: cannot be read as a search; delete it, or give another folder with --out"
        ) from None
    if differences:
        raise UserError(
            f"{out}: holds another search, which differs:\n{list_lines(differences)}\n"
            "Nothing was changed. Give another folder with --out, or delete this one"
        )
    return earlier


def write_search(
    out: Path,
    record: dict[str, Any],
    template: str,
    draw: Callable[[dict[str, Any]], Sequence[Chart]],
) -> list[str]:
    """Write all files of a search, each atomically, and return the sentences of its page. Raises
    StoreError if the disk refuses.

    `draw`: makes the charts of the result.
    """
    figure = f"{record['kind']}.svg"
    panels.save_panels(out / figure, draw(record["result"]))
    text = _render(template, record=record, numbers=record["result"], figure=figure)
    files.write_text(out / TEXT, text)
    drawing = (out / figure).read_text(encoding="utf-8")
    files.write_text(out / PAGE, html.from_markdown(text, {figure: drawing}))
    _json(out / NUMBERS, record)
    return [line[2:] for line in text.splitlines() if line.startswith("- ")]


def _json(path: Path, record: dict[str, Any]) -> None:
    files.write_text(path, json.dumps(files.json_values(record), indent=1) + "\n")


def _render(template: str, **values: Any) -> str:
    templates = wording.text_templates("ravenjax.analyses.search")
    templates.filters |= {
        "cell": lambda value: str(value).replace("|", r"\|"),
        "general": "{:g}".format,
        "header": _header,
        "largest": lambda values, most: np.argsort(-values)[:most],
        "laws": describe_inputs,
        "number": format_number,
        "short": short_axis_name,
        "step": lambda step: f"{step[0]:g} to {step[1]:g} ms",
        "words": describe_case,
    }
    templates.globals |= {
        "list_steps": lambda slopes: sorted({(one["from_ms"], one["to_ms"]) for one in slopes}),
        "list_values": lambda cells, name: sorted({record["cell"][name] for record in cells}),
        "series": group_series,
        "smallest": lambda cells: min(cells, key=lambda record: abs(record["harmful"])),
    }
    return templates.get_template(template).render(values)


def _header(names: Sequence[str]) -> str:
    row = " | ".join(name.replace("|", r"\|") for name in names)
    return f"| {row} |\n|{'---|' * len(names)}"
