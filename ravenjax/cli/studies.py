"""Commands on the studies of a checkout, `analysis/studies`: `reproduce` runs them, `credibility`
tells what each of their claims rests on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.checkout import load_module
from ravenjax.cli.console import Listing
from ravenjax.errors import UserError


def reproduce(
    name: str | None = None,
    *,
    out: Annotated[Path, Parameter(help="folder; each study has one inside")] = Path(
        "results/reproduce"
    ),
    engine: Annotated[str, Parameter(help="auto, cuda, simd, xla or mjx")] = "auto",
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

    studies, files, claims = map(load_module, ("studies", "studies.findings", "studies.claims"))
    targets, plain, standings = (
        getattr(load_module("studies.study"), name) for name in ("targets", "plain", "standings")
    )
    if name is None:
        rows = [
            (one.name, one.title, ", ".join(one.targets), f"{one.minutes:g}")
            for one in map(studies.find, studies.NAMES)
        ]
        listings = [
            Listing(
                "studies",
                "Studies: ravenjax reproduce NAME",
                ("name", "what", "targets", "minutes"),
                rows,
            ),
            Listing(
                "targets",
                "Targets: met where every line with a band is inside it",
                ("target", "what", "published", "band", "judged by"),
                [tuple(target) for target in targets().values()],
            ),
        ]
        console.emit(listings, as_json)
        return
    chosen = [studies.find(one) for one in (studies.NAMES if name == "all" else (name,))]
    for study in chosen:
        folder = out / study.name
        with terminal.Watch(console.err if as_json else console.out) as watch:
            findings = files.reproduce(study, out, engine, watch)
        if not as_json:
            if findings.lines:
                rows = files.line_rows(findings)
                console.out.print(terminal.table(study.title, files.BRIEF_COLUMNS, rows))
            for state in standings(plain(findings)["lines"]):
                console.say(f"{state.sentence}. {targets()[state.id].definition}")
            for answer in claims.answers(files.read(folder)):
                console.say(f"- {answer}")
            console.say(f"findings: {folder / files.PAGE}")
            console.say(f"page: {folder / files.HTML}")
        if keep is not None:
            files.keep(folder, keep / study.name)
    for folder in filter(None, (out, keep)):
        page = files.write_credibility(folder, studies.NAMES)
        if not as_json:
            console.say(f"credibility: {page}")
    if as_json:
        console.emit_json(
            [{"folder": out / study.name} | files.read(out / study.name) for study in chosen]
        )


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
    from ravenjax.store.files import write_aside

    records = load_module("studies.findings").records(folder, load_module("studies").NAMES)
    if not records:
        raise UserError(
            f"{folder}: no findings of a study there; run `ravenjax reproduce NAME --out {folder}`"
            " first"
        )
    text = load_module("studies.claims").page(records, out.parent.as_posix() if out else "")
    if out is None:
        print(text, end="")
        return
    write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)
