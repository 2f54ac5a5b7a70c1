"""Implements `ravenjax reproduce`, `ravenjax credibility` and `ravenjax evidence --credibility`."""

import re
from pathlib import Path

import ravenjax
import studies
from evidence.writing import CredibilityStatement, ModelCredibility
from ravenjax.cli import console, terminal
from ravenjax.cli.console import Listing
from ravenjax.store.files import write_aside
from studies import claims, findings
from studies.study import standings, targets


def reproduce(name: str | None, out: Path, engine: str, keep: Path | None, as_json: bool) -> None:
    """Run `ravenjax reproduce`."""
    if name is None:
        rows = [
            (one.name, one.title, ", ".join(one.targets), f"{one.minutes:g}")
            for one in map(studies.find, studies.NAMES)
        ]
        columns = ("name", "title", "targets", "minutes")
        listed = Listing("studies", "Studies: ravenjax reproduce NAME", columns, rows)
        columns = ("target", "title", "published", "band", "judged by")
        words = "Targets: met if every line with a band is inside its band"
        met = Listing("targets", words, columns, [tuple(one) for one in targets().values()])
        return console.print_tables([listed, met], as_json)
    chosen = [studies.find(one) for one in (studies.NAMES if name == "all" else (name,))]
    for study in chosen:
        folder = out / study.name
        with terminal.Watch(console.err if as_json else console.out) as watch:
            findings.reproduce(study, out, engine, watch)
        if not as_json:
            _print_findings(study.title, folder)
        if keep is not None:
            findings.keep(folder, keep / study.name)
    for folder in filter(None, (out, keep)):
        page = findings.write_credibility(folder)
        if not as_json:
            console.print_text(f"credibility: {page}")
    if as_json:
        folders = [out / study.name for study in chosen]
        console.emit_json([{"folder": path} | findings.read(path) for path in folders])
    return None


def _print_findings(title: str, folder: Path) -> None:
    record = findings.read(folder)
    if rows := findings.line_rows(record):
        console.print_table(title, findings.BRIEF_COLUMNS, rows)
    for target, sentence in standings(record["lines"]).items():
        console.print_text(f"{sentence}. {targets()[target].definition}")
    for claim in claims.read_claims(folder.name).claim:
        answer, limit = (
            claims.filled(text, claim.numbers, record)
            for text in (claim.answer, claim.not_adequate_for)
        )
        console.print_text(f"- {claim.title}: {answer} Not adequate for {limit}")
    console.print_text(f"findings: {folder / findings.PAGE}")
    console.print_text(f"page: {folder / findings.HTML}")


def credibility(folder: Path, out: Path | None) -> None:
    """Run `ravenjax credibility`."""
    text = claims.page(findings.records(folder), out.parent.as_posix() if out else "")
    if out is None:
        print(text, end="")
        return
    write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)


def model_credibility(folder: Path) -> ModelCredibility:
    """Return what studies say of the simulator, with numbers from their findings in `folder`."""
    records, statements = findings.records(folder), []
    root = Path(ravenjax.__file__).resolve().parents[1]
    for one in claims.of_model().values():
        places = [root / re.split("::|#", place)[0] for place in (*one.tests, *one.pages)]
        if one.tables or one.numbers:
            places.append(folder.resolve() / one.study / findings.JSON)
        text = claims.filled(one.text, one.numbers, records.get(one.study) if one.study else None)
        files = tuple(dict.fromkeys(places))
        statements.append(CredibilityStatement(one.category, one.name, text, files))
    return ModelCredibility(claims.CATEGORIES, tuple(statements), root)
