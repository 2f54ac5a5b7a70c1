"""Writes the folder of evidence for a risk file, and checks whether its files have changed."""

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from evidence import argument, risk_tables, workbook
from evidence import record as records
from evidence.record import EvidenceRecord, Item, Source, fill_template, opened
from ravenjax.report import downloads
from ravenjax.store import manifest as manifests
from ravenjax.store.files import hash_file, require_writable, write_aside

FOLDER = "evidence"
"""Default subfolder of a result folder."""
README, JSON, MERMAID = "README.md", "argument.json", "argument.mmd"
GOALS = {
    "trace_matrix.csv": "Each group of faults is counted by hazard.",
    "trace.csv": "Each run that ended in a hazard is named, with the checksum of its part.",
    "failure_modes.csv": "Each failure mode has its end effect, who detected it, rate and runs.",
    "control_actions.csv": "Each hazard of motion is an unsafe control action of a stated kind.",
}
"""Tables, and the goal that each supports."""
CREDIBILITY = "credibility.md"
CREDIBILITY_GOAL = (
    "The evidence for the simulator's credibility is stated by category, with its files."
)
NO_ROWS = "result,campaign\n"
"""A table without lines."""


class CredibilityStatement(NamedTuple):
    category: str
    name: str
    text: str
    files: tuple[Path, ...]


class ModelCredibility(NamedTuple):
    """All statements about the model."""

    categories: tuple[str, ...]  # all categories, in the guidance's order
    statements: tuple[CredibilityStatement, ...]
    root: Path  # of the repository; file names are relative to it


def _link_files(model: ModelCredibility, place: Path) -> tuple[Item, ...]:
    """Return each existing file once, relative to the folder of the evidence, with its checksum."""
    files = dict.fromkeys(file for one in model.statements for file in one.files if file.is_file())
    paths = {file: Path(os.path.relpath(file, place)).as_posix() for file in files}
    return tuple(Item(file=path, sha256=hash_file(file)) for file, path in paths.items())


def _write_report(model: ModelCredibility, sources: Sequence[Source], place: Path) -> str:
    """Return the report in Markdown. `place` is the folder of the evidence."""

    def name_file(file: Path) -> str:
        inside = file.is_relative_to(model.root)
        return file.relative_to(model.root).as_posix() if inside else file.name

    values = {"model": model, "sources": sources, "name_file": name_file, "sha256": hash_file}
    link = lambda file: Path(os.path.relpath(file, place)).as_posix()  # noqa: E731
    return fill_template("credibility.md.j2", link=link, **values)


def write(
    folders: Sequence[Path], place: Path, xlsx: bool = False, model: ModelCredibility | None = None
) -> EvidenceRecord:
    """Write evidence of result folders into the folder `place`, replacing files of the same names.

    `xlsx`: also write the tables as one workbook. `model`: evidence on the simulator's credibility,
    for a report on it. Raises UserError and StoreError.
    """
    if xlsx:
        workbook.require_writer()
    with opened(folders) as sources:
        require_writable(place)
        goals: dict[str, tuple[str, str]] = {}
        links = {}

        def add_file(name: str, goal: str, write_file: Callable[[Path], object]) -> None:
            write_aside(place / name, write_file)
            goals[name] = goal, hash_file(place / name)

        counts = {
            "failure_modes.csv": risk_tables.count_failure_modes,
            "control_actions.csv": risk_tables.count_control_actions,
            "trace_matrix.csv": risk_tables.count_matrix,
        }
        for name, goal in GOALS.items():
            write_table = lambda target: risk_tables.write_trace(target, sources)  # noqa: E731
            if count := counts.get(name):
                rows = pd.concat(map(count, sources)).to_dict("records")
                write_table = _writer_of(downloads.format_csv(rows) or NO_ROWS)
            add_file(name, goal, write_table)
        # Files of an earlier call would contradict the new tables.
        for name in (workbook.FILE, CREDIBILITY):
            (place / name).unlink(missing_ok=True)
        if xlsx:
            write_book = partial(workbook.write_workbook, tables=[place / name for name in GOALS])
            add_file(workbook.FILE, workbook.GOAL, write_book)
        if model is not None:
            report = _write_report(model, sources, place)
            add_file(CREDIBILITY, CREDIBILITY_GOAL, _writer_of(report))
            links[CREDIBILITY] = _link_files(model, place)
        evidence = EvidenceRecord(
            written=manifests.utc_now(),
            sentences=tuple(line for source in sources for line in argument.say_all(source)),
            nodes=tuple(argument.build_argument(sources, place, goals, links)),
        )
        names = {"json": JSON, "mermaid": MERMAID, "record": records.FILE}
        shown = {"sources": sources, "goals": GOALS, "kinds": risk_tables.KINDS, **names}
        readme = fill_template("README.md.j2", evidence=evidence, **shown)
        write_aside(place / README, _writer_of(readme))
    _write_argument(place, evidence)
    records.write_record(place, evidence)
    return evidence


def check(place: Path) -> EvidenceRecord:
    """Compute every checksum again, and write the argument, but not the record."""
    evidence = records.check_record(place, records.read_record(place))
    _write_argument(place, evidence)
    return evidence


def files(place: Path) -> list[Path]:
    """Return the files that `write` wrote, in order."""
    extras = [name for name in (workbook.FILE, CREDIBILITY) if (place / name).is_file()]
    return [place / name for name in (*GOALS, *extras, JSON, MERMAID, README, records.FILE)]


def _writer_of(text: str) -> Callable[[Path], object]:
    return lambda target: target.write_text(text, encoding="utf-8")


def _write_argument(place: Path, evidence: EvidenceRecord) -> None:
    write_aside(place / JSON, _writer_of(evidence.model_dump_json(indent=1) + "\n"))
    drawing = "\n".join(argument.draw_mermaid(evidence)) + "\n"
    write_aside(place / MERMAID, _writer_of(drawing))
