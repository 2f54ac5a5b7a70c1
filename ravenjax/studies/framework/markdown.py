"""Findings as text: lines for a terminal, the whole as a Markdown page, made from the record that `writing` keeps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from ravenjax.report import wording
from ravenjax.studies.framework import targets
from ravenjax.studies.framework.study import Findings, plain

Record = Mapping[str, Any]
"""findings.json."""

LINE_COLUMNS = ("quantity", "published", "predicted", "band", "inside", "likely reason of a difference")
BRIEF_COLUMNS = LINE_COLUMNS[:-1]
INSIDE = {True: "yes", False: "NO", None: ""}


def line_rows(findings: Findings) -> list[tuple[str, ...]]:
    """The lines as a terminal has room for them, columns as in BRIEF_COLUMNS: numbers without their origin."""
    return [tuple(cell.partition(";")[0] for cell in _line(line)[:-1]) for line in plain(findings)["lines"]]


def page(record: Record, pictures: bool) -> str:
    """The Markdown page of a record; `pictures`: with the drawings, which then lie beside it."""
    study, provenance = record["study"], record["provenance"]
    parts = [f"# {study['title']}", f"{study['question']}", f"Source: {study['source']}", _verdict(record["lines"])]
    if record["lines"]:
        compared = any(line["published"] for line in record["lines"])
        heading = "## Published and predicted" if compared else "## In numbers"
        parts += [heading, _LEGEND, _table(LINE_COLUMNS, map(_line, record["lines"]))]
    if pictures and record["drawings"]:
        parts.append("## Figures")
        for drawing in record["drawings"]:
            parts += [f"![{_escaped(drawing['caption'])}]({drawing['name']}.svg)", drawing["caption"]]
    if record["notes"]:
        parts += ["## Notes", *record["notes"]]
    for table in record["tables"]:
        rows = (tuple(map(_cell, row)) for row in table["rows"])
        parts += [f"## {table['title']}", _table(table["columns"], rows), table["note"]]
    return "\n\n".join(part for part in (*parts, *_made_by(study["name"], provenance)) if part) + "\n"


_LEGEND = (
    "A number is followed by its interval and by what it was counted over or read from. *Band* is the acceptance band "
    "of the predicted value."
)


def verdicts(lines: Sequence[Record]) -> list[str]:
    """One sentence for each target that the lines belong to."""
    return [targets.sentence(state) for state in targets.states(lines)]


def _verdict(lines: Sequence[Record]) -> str:
    words = verdicts(lines)
    definitions = [f"- {text}" for state in targets.states(lines) if (text := targets.definition(state.id))]
    if not words:
        return ""
    return f"**{'. '.join(words)}.**" + ("\n\n" + "\n".join(definitions) if definitions else "")


def _line(line: Record) -> tuple[str, ...]:
    unit = f", {line['unit']}" if line["unit"] else ""
    target = f"{line['target']}: " if line["target"] else ""
    band = "" if line["band"] is None else _range(*line["band"])
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
    text = _number(estimate["value"])
    if estimate["low"] is not None and estimate["high"] is not None:
        text += f" ({_range(estimate['low'], estimate['high'])})"
    if estimate["n"]:
        return f"{text}; {wording.count(estimate['n'])} {estimate['of']}".rstrip()
    return f"{text}; {estimate['of']}" if estimate["of"] else text


def _range(low: float | None, high: float | None) -> str:
    """An infinite end is null in the record."""
    if low is None or high is None:
        return f"at most {_number(high)}" if low is None else f"at least {_number(low)}"
    return _number(low) if low == high else f"{_number(low)} to {_number(high)}"


def _number(value: float | None) -> str:
    return wording.DASH if value is None else wording.number(value)


def _cell(value: str | float | None) -> str:
    return value if isinstance(value, str) else _number(value)


def _made_by(name: str, made: Record) -> Iterator[str]:
    yield "## How it was made"
    yield f"```\nravenjax reproduce {name}\n```"
    rows = [
        (c["variant"], wording.count(c["runs"]), wording.number(c["seconds"]), c["question"], f"`{c['command']}`")
        for c in made["campaigns"]
    ]
    yield _table(("campaign", "runs", "length, s", "what it answers otherwise", "alone"), rows)
    versions = ", ".join(f"{package} {version}" for package, version in made["versions"].items())
    yield f"Engine {made['engine']} on {made['device']}; code {made['code_hash'][:16]}; {versions}."


def _table(columns: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    heads = [_escaped(column) for column in columns]
    body = ["| " + " | ".join(map(_escaped, row)) + " |" for row in rows]
    return "\n".join(["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), *body])


def _escaped(text: str) -> str:
    """Text that stays in one cell."""
    return " ".join(text.split()).replace("|", r"\|")
