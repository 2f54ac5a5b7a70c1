"""Implements `ravenjax reproduce`, `ravenjax credibility` and `ravenjax evidence --credibility`."""

import re
from pathlib import Path

import ravenjax
import studies
from evidence.writing import CredibilityStatement, ModelCredibility
from ravenjax.cli import console, terminal
from ravenjax.cli.console import Listing
from ravenjax.errors import UserError
from ravenjax.store.files import write_aside
from studies import claims
from studies import findings as findings_files
from studies.study import standings, targets


def reproduce(name: str | None, out: Path, engine: str, keep: Path | None, as_json: bool) -> None:
    """Run `ravenjax reproduce`."""
    if name is None:
        rows = [
            (one.name, one.title, ", ".join(one.targets), f"{one.minutes:g}")
            for one in map(studies.find, studies.NAMES)
        ]
        heads = "studies", "Studies: ravenjax reproduce NAME"
        listings = [Listing(*heads, ("name", "what", "targets", "minutes"), rows)]
        heads = "targets", "Targets: met where every line with a band is inside it"
        columns = ("target", "what", "published", "band", "judged by")
        rows = [tuple(target) for target in targets().values()]
        listings.append(Listing(*heads, columns, rows))
        console.print_tables(listings, as_json)
        return
    chosen = [studies.find(one) for one in (studies.NAMES if name == "all" else (name,))]
    for study in chosen:
        folder = out / study.name
        with terminal.Watch(console.err if as_json else console.out) as watch:
            findings_files.reproduce(study, out, engine, watch)
        if not as_json:
            _print_findings(study.title, folder)
        if keep is not None:
            findings_files.keep(folder, keep / study.name)
    for folder in filter(None, (out, keep)):
        page = findings_files.write_credibility(folder)
        if not as_json:
            console.print_text(f"credibility: {page}")
    if as_json:
        folders = [out / study.name for study in chosen]
        console.emit_json([{"folder": path} | findings_files.read(path) for path in folders])


def _print_findings(title: str, folder: Path) -> None:
    record = findings_files.read(folder)
    if rows := findings_files.line_rows(record):
        console.print_table(title, findings_files.BRIEF_COLUMNS, rows)
    for target, sentence in standings(record["lines"]).items():
        console.print_text(f"{sentence}. {targets()[target].definition}")
    for claim in claims.read_claims(folder.name).claim:
        answer, limit = (
            claims.filled(text, claim.numbers, record)
            for text in (claim.answer, claim.not_adequate_for)
        )
        console.print_text(f"- {claim.title}: {answer} Not adequate for {limit}")
    console.print_text(f"findings: {folder / findings_files.PAGE}")
    console.print_text(f"page: {folder / findings_files.HTML}")


def credibility(folder: Path, out: Path | None) -> None:
    """Run `ravenjax credibility`."""
    records = findings_files.records(folder)
    if not records:
        raise UserError(
            f"{folder}: no findings of a study there; run `ravenjax reproduce NAME --out {folder}`"
            " first"
        )
    text = claims.page(records, out.parent.as_posix() if out else "")
    if out is None:
        print(text, end="")
        return
    write_aside(out, lambda target: target.write_text(text, encoding="utf-8"))
    console.out.print(f"wrote {out}", highlight=False, soft_wrap=True)


def model_credibility(folder: Path) -> ModelCredibility:
    """Return what studies say of the simulator, with numbers from their findings in `folder`."""
    records = findings_files.records(folder)
    if not records:
        raise UserError(
            f"--credibility {folder}: no findings of a study there; a checkout has some in"
            f" results/reference, `ravenjax reproduce NAME --out {folder}` makes them"
        )
    root = Path(ravenjax.__file__).resolve().parents[1]
    statements = []
    for one in claims.of_model().values():
        places = [root / re.split("::|#", place)[0] for place in (*one.tests, *one.pages)]
        if one.tables or one.numbers:
            places.append(folder.resolve() / one.study / findings_files.JSON)
        text = claims.filled(one.text, one.numbers, records.get(one.study) if one.study else None)
        files = tuple(dict.fromkeys(places))
        statements.append(CredibilityStatement(one.category, one.name, text, files))
    return ModelCredibility(claims.CATEGORIES, tuple(statements), root)
