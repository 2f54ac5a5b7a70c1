"""Findings as text: lines for a terminal, the whole as a Markdown page, made from the record
that `writing` keeps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ravenjax.report import wording
from studies.framework import cells, credibility, targets
from studies.framework.study import Findings, plain

Record = Mapping[str, Any]
"""findings.json."""

LINE_COLUMNS = (
    "quantity",
    "published",
    "predicted",
    "band",
    "inside",
    "likely reason of a difference",
)
BRIEF_COLUMNS = LINE_COLUMNS[:-1]
INSIDE = {True: "yes", False: "NO", None: ""}


def line_rows(findings: Findings) -> list[tuple[str, ...]]:
    """The lines as a terminal has room for them, columns as in BRIEF_COLUMNS: numbers without
    their origin.
    """
    return [
        tuple(cell.partition(";")[0] for cell in _line(line)[:-1])
        for line in plain(findings)["lines"]
    ]


def page(record: Record, pictures: bool) -> str:
    """The Markdown page of a record.

    pictures: with the drawings, which then lie beside it, and with the study's claims; a page that
    is kept leaves them to the page over all studies.
    """
    study, provenance = record["study"], record["provenance"]
    parts = [
        f"# {study['title']}",
        f"{study['question']}",
        f"Source: {study['source']}",
        _verdict(record["lines"]),
    ]
    if record["lines"]:
        compared = any(line["published"] for line in record["lines"])
        heading = "## Published and predicted" if compared else "## In numbers"
        parts += [heading, _LEGEND, cells.table(LINE_COLUMNS, map(_line, record["lines"]))]
    if pictures and record["drawings"]:
        parts.append("## Figures")
        for drawing in record["drawings"]:
            parts += [
                f"![{cells.escaped(drawing['caption'])}]({drawing['name']}.svg)",
                drawing["caption"],
            ]
    if record["notes"]:
        parts += ["## Notes", *record["notes"]]
    for table in record["tables"]:
        rows = (tuple(map(cells.cell, row)) for row in table["rows"])
        parts += [f"## {table['title']}", cells.table(table["columns"], rows), table["note"]]
    parts += [credibility.section(record) if pictures else "", *_made_by(study["name"], provenance)]
    return "\n\n".join(part for part in parts if part) + "\n"


_LEGEND = (
    "A number is followed by its interval and by what it was counted over or read from. *Band* is"
    " the acceptance band of the predicted value."
)


def verdicts(lines: Sequence[Record]) -> list[str]:
    """One sentence for each target that the lines belong to."""
    return [targets.sentence(state) for state in targets.states(lines)]


def _verdict(lines: Sequence[Record]) -> str:
    words = verdicts(lines)
    definitions = [
        f"- {text}" for state in targets.states(lines) if (text := targets.definition(state.id))
    ]
    if not words:
        return ""
    return f"**{'. '.join(words)}.**" + ("\n\n" + "\n".join(definitions) if definitions else "")


def _line(line: Record) -> tuple[str, ...]:
    unit = f", {line['unit']}" if line["unit"] else ""
    target = f"{line['target']}: " if line["target"] else ""
    band = "" if line["band"] is None else cells.span(*line["band"])
    return (
        f"{target}{line['quantity']}{unit}",
        _estimate(line["published"]),
        _estimate(line["predicted"]),
        band,
        INSIDE[line["passed"]],
        line["reason"],
    )


def _estimate(estimate: Record | None) -> str:
    if estimate is None:
        return wording.DASH
    text, over = cells.with_interval(estimate), cells.counted_over(estimate)
    return f"{text}; {over}" if over else text


def _made_by(name: str, made: Record) -> Iterator[str]:
    yield "## How it was made"
    yield f"```\nravenjax reproduce {name}\n```"
    rows = [
        (
            c["variant"],
            wording.count(c["runs"]),
            wording.number(c["seconds"]),
            c["question"],
            f"`{c['command']}`",
        )
        for c in made["campaigns"]
    ]
    yield cells.table(("campaign", "runs", "length, s", "what it answers otherwise", "alone"), rows)
    versions = ", ".join(f"{package} {version}" for package, version in made["versions"].items())
    engine = (
        f"Engine {made['engine']} on {made['device']}; code" if made["engine"] else "Code"
    )  # of some runs, or none
    yield f"{engine} {made['code_hash'][:16]}; {versions}."
