"""Writes the report on the simulator's credibility: statements by category of FDA's guidance of
November 2023, with their files. The caller provides the statements.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from evidence.record import Item, fill_template
from evidence.sources import Source
from ravenjax.store.files import hash_file

FILE = "credibility.md"
GOAL = "The evidence for the simulator's credibility is stated by category, with its files."


class CredibilityStatement(NamedTuple):
    """One statement about the model, and the files that support it."""

    category: str
    name: str
    text: str
    files: tuple[Path, ...]


class ModelCredibility(NamedTuple):
    """All statements about the model."""

    categories: tuple[str, ...]  # all categories, in the guidance's order
    statements: tuple[CredibilityStatement, ...]
    root: Path  # of the repository; file names are relative to it


def link_files(model: ModelCredibility, place: Path) -> tuple[Item, ...]:
    """Return each existing file once, relative to the folder of the evidence, with its checksum."""
    files = dict.fromkeys(file for one in model.statements for file in one.files if file.is_file())
    paths = {file: Path(os.path.relpath(file, place)).as_posix() for file in files}
    return tuple(Item(file=path, sha256=hash_file(file)) for file, path in paths.items())


def write_report(model: ModelCredibility, sources: Sequence[Source], place: Path) -> str:
    """Return the report in Markdown. `place` is the folder of the evidence."""

    def name_file(file: Path) -> str:
        inside = file.is_relative_to(model.root)
        return file.relative_to(model.root).as_posix() if inside else file.name

    return fill_template(
        "credibility.md.j2",
        model=model,
        sources=sources,
        name_file=name_file,
        link=lambda file: Path(os.path.relpath(file, place)).as_posix(),
        sha256=hash_file,
    )
