"""What the simulator's own credibility rests on, by category of evidence, each statement with the
files that it is of.

Categories are those of FDA's guidance *Assessing the Credibility of Computational Modeling and
Simulation in Medical Device Submissions* (November 2023). Who calls brings the statements; here
each file is sought and its checksum taken.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ravenjax.evidence.record import NOTICE, Item
from ravenjax.evidence.sources import Source
from ravenjax.store.files import sha256

FILE = "credibility.md"
GOAL = (
    "What the simulator's credibility rests on is stated by category, each statement with its"
    " files."
)
YOURS = (
    ("Question of interest", "which question of yours these results are to help answer"),
    ("Context of use", "what the simulation contributes to the answer, beside what else"),
    ("Model risk", "its influence on the decision, and the consequence of a wrong one"),
    ("Credibility goals", "what you asked of each category beforehand, and whether it is met"),
    ("Adequacy", "whether the evidence below suffices for that use"),
)
"""Steps of the guidance that nobody else can take."""


class CredibilityStatement(NamedTuple):
    """What is known of the model, and where."""

    category: str
    name: str
    text: str
    files: tuple[Path, ...]


class ModelCredibility(NamedTuple):
    """All that is known of the model."""

    categories: tuple[str, ...]  # all there are, in the guidance's order
    statements: tuple[CredibilityStatement, ...]
    root: Path  # of the repository; files are named from there


def link_files(model: ModelCredibility, place: Path) -> tuple[Item, ...]:
    """Each file that is there, once, from the folder of the evidence, with its checksum."""
    files = dict.fromkeys(file for one in model.statements for file in one.files if file.is_file())
    return tuple(
        Item(file=Path(os.path.relpath(file, place)).as_posix(), sha256=sha256(file))
        for file in files
    )


def write_report(model: ModelCredibility, sources: Sequence[Source], place: Path) -> str:
    """The report, in Markdown; `place` is the folder of the evidence."""
    return "\n".join(_lines(model, sources, place)) + "\n"


def _lines(model: ModelCredibility, sources: Sequence[Source], place: Path) -> Iterator[str]:
    yield f"# Credibility of the simulator\n\n**{NOTICE}**\n"
    yield (
        "Evidence stands by the eight categories of FDA's guidance *Assessing the Credibility of"
        " Computational Modeling and Simulation in Medical Device Submissions* (November 2023). It"
        " is evidence of the simulator as it is in this repository; whether it is enough depends on"
        " a use that this report does not know. ravenjax is no medical device and part of no"
        " submission.\n"
    )
    yield "## What only you can say\n\n| step | to be written |\n|---|---|"
    yield from (f"| {step} | {what} |" for step, what in YOURS)
    yield (
        "\n## The results of this folder\n\n| result | campaign | asks | configuration | code |"
        " engine |"
    )
    yield "|---|---|---|---|---|---|"
    for source in sources:
        record = source.record
        asks = (record.config.get("campaign") or {}).get("description") or "not said"
        cells = (
            source.name,
            record.campaign,
            asks,
            record.config_hash[:16],
            record.code_hash[:16],
            record.engine,
        )
        yield f"| {' | '.join(_cell(cell) for cell in cells)} |"
    yield (
        "\nStatements are of the repository as it was when this was written. A result of other code"
        " was computed by another simulator.\n"
    )
    for category in model.categories:
        yield f"## {category[:1].upper()}{category[1:]}\n"
        statements = [one for one in model.statements if one.category == category]
        for one in statements:
            yield f"### {one.name[:1].upper()}{one.name[1:]}\n\n{one.text}\n"
            yield from (_linked(model, file, place) for file in one.files)
            yield ""
        if not statements:
            yield "No evidence.\n"


def _linked(model: ModelCredibility, file: Path, place: Path) -> str:
    name = file.relative_to(model.root).as_posix() if file.is_relative_to(model.root) else file.name
    if not file.is_file():
        return f"- `{name}`: not in this installation"
    return f"- [{name}]({Path(os.path.relpath(file, place)).as_posix()}), sha256 `{sha256(file)}`"


def _cell(words: str) -> str:
    return words.replace("|", "\\|").replace("\n", " ")
