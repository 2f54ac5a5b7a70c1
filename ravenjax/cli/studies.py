"""Commands on the studies of a checkout, `analysis/studies`: `reproduce` runs them, `credibility`
tells what each of their claims rests on.

The package comes without them; they are loaded by path when a command asks for them.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import ravenjax
from ravenjax.cli import console
from ravenjax.cli.console import Listing
from ravenjax.errors import UserError


def load(name: str) -> Any:
    """Module `name` of `analysis/studies`. Raises UserError outside of a checkout."""
    folder = Path(ravenjax.__file__).resolve().parents[1] / "analysis"
    if not (folder / "studies" / "__init__.py").is_file():
        raise UserError(
            "the studies are no part of the installed package, and this is no checkout:"
            f" {folder / 'studies'} is missing; clone the repository and install it with"
            " `pip install -e .`"
        )
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    return importlib.import_module(f"studies.{name}")


def reproduce(
    name: str | None = None,
    *,
    out: Annotated[Path, Parameter(help="folder; each study has one inside")] = Path(
        "results/reproduce"
    ),
    engine: Annotated[str, Parameter(help="auto, cuda, simd, wasm, xla or mjx")] = "auto",
    keep: Annotated[
        Path | None, Parameter(help="also copy the findings, without pictures, into this folder")
    ] = None,
    as_json: Annotated[
        bool,
        Parameter(
            name="--json", negative="", help="list the studies as JSON; of a study, its findings"
        ),
    ] = False,
) -> None:
    """Run a published experiment, or a study of our own, and set what is predicted beside what was
    published.

    Parameters
    ----------
    name
        The study, or "all". Without one: list them.
    """
    from ravenjax.cli import terminal

    catalogue, running = load("catalogue"), load("running")
    page, markdown = load("framework.credibility"), load("framework.markdown")
    targets, writing = load("framework.targets"), load("framework.writing")
    plain = load("framework.study").plain

    if name is None:
        studies = [catalogue.find(one_name) for one_name in catalogue.NAMES]
        rows = [
            (one.name, one.title, ", ".join(one.targets), f"{one.minutes:g}") for one in studies
        ]
        columns = ("name", "what", "targets", "minutes")
        goals = [
            (one.id, one.title, one.source, one.band, one.judged_by)
            for one in targets.targets().values()
        ]
        listings = [
            Listing("studies", "Studies: ravenjax reproduce NAME", columns, rows),
            Listing(
                "targets",
                "Targets: met where every line with a band is inside it",
                ("target", "what", "published", "band", "judged by"),
                goals,
            ),
        ]
        console.emit(listings, as_json)
        return
    names = catalogue.NAMES if name == "all" else (catalogue.find(name).name,)
    for study in names:
        with terminal.Watch(console.err if as_json else console.out) as watch:
            findings = running.reproduce(study, out, engine, watch)
        if not as_json and findings.lines:
            title = catalogue.find(study).title
            console.out.print(
                terminal.table(title, markdown.BRIEF_COLUMNS, markdown.line_rows(findings))
            )
        if not as_json:
            for state in targets.states(plain(findings)["lines"]):
                console.say(f"{targets.sentence(state)}. {targets.definition(state.id)}")
            for answer in page.answers(writing.read(out / study)):
                console.say(f"- {answer}")
            console.say(f"findings: {out / study / writing.PAGE}")
            console.say(f"page: {out / study / writing.HTML}")
        if keep is not None:
            writing.keep(out / study, keep / study)
    for folder in filter(None, (out, keep)):
        page = writing.write_credibility(folder, catalogue.NAMES)
        if not as_json:
            console.say(f"credibility: {page}")
    if as_json:
        console.emit_json([_file(out / study, writing.JSON) for study in names])


def _file(folder: Path, name: str) -> dict[str, Any]:
    """What a file of JSON in a folder says, and the folder."""
    return {"folder": folder} | json.loads((folder / name).read_text(encoding="utf-8"))


def credibility(
    folder: Path = Path("results/reproduce"),
    *,
    out: Annotated[Path | None, Parameter(help="write it to this file; default: print it")] = None,
) -> None:
    """Tell for each claim of the studies what it rests on, in the order of FDA's guidance of 2023
    (Markdown).

    Parameters
    ----------
    folder
        Findings of `ravenjax reproduce`: its folder --out, or --keep.
    """
    from ravenjax.store import files

    page, writing = load("framework.credibility"), load("framework.writing")
    records = writing.records(folder, load("catalogue").NAMES)
    if not records:
        raise UserError(
            f"{folder}: no findings of a study there; run `ravenjax reproduce NAME --out {folder}`"
            " first"
        )
    text = page.page(records, out.parent.as_posix() if out else "")
    if out is None:
        print(text, end="")
        return
    files.write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)
