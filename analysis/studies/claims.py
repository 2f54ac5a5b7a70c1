"""Writes what each study claims and which evidence supports it, as Markdown.

The data are in `claims/NAME.toml`, one file per study. They become part of a study's page, and of
one page over all studies. Terms and their order are those of the guidance *Assessing the
Credibility of Computational Modeling and Simulation in Medical Device Submissions* (FDA, November
2023). Evidence that several claims share is in `claims/model.toml`.

A text may hold numbers of findings, each by its name in braces. `numbers` says where each is read,
so that no number is typed by hand:

    answer = "The predicted mean is {mean}, over {mean.over}; published is {mean.published}."
    numbers.mean = { line = "mean tip error of all segments" }

In patterns for a line's quantity, a table's title, a row or a column, * matches any text.
"""

import posixpath
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from ravenjax.errors import UserError
from studies import cells
from studies.study import standings

Record = Mapping[str, Any]
"""Content of findings.json."""

FOLDER = Path(__file__).parent / "claims"

Category = Literal[
    "code verification",
    "model calibration",
    "bench test validation",
    "in vivo validation",
    "population-based validation",
    "emergent model behavior",
    "model plausibility",
    "calculation verification and uncertainty quantification",
]
CATEGORIES: tuple[Category, ...] = Category.__args__
"""The eight categories of credibility evidence, in the guidance's order."""
Level = Literal["low", "medium", "high"]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Quotation(_Strict):
    """The place of a number in findings: a line, a cell, a target, or a count of lines inside their
    bands.
    """

    line: str = ""  # quantity of a line
    table: str = ""  # title of a table; used with row and column
    row: tuple[str, ...] = ()  # first cells of the row
    column: str = ""
    target: str = ""  # target such as A1; quotes what its lines say
    inside: str = ""  # Quantities of lines; those inside their band are counted.


class Evidence(_Strict):
    """Evidence for or against a claim, and the places that show it."""

    category: Category
    text: str
    tests: tuple[str, ...] = ()  # tests/... or analysis/..., with a test's name after ::
    pages: tuple[str, ...] = ()  # docs/... or models/..., with a heading's anchor after #
    tables: tuple[str, ...] = ()  # titles of tables of the study's findings


class ModelEvidence(Evidence):
    """Evidence that several claims share."""

    name: str  # name by which claims refer to it
    study: str = ""  # study whose findings its tables and numbers come from
    numbers: dict[str, Quotation] = {}


class Claim(_Strict):
    """One answer of a study, in the guidance's order, and what would change it."""

    title: str  # subject of the claim, without its number
    question: str  # question of interest
    context_of_use: str  # what the model is used for to answer it
    influence: Level  # influence of the model on the answer, beside other evidence
    consequence: Level  # consequence of a wrong answer for the decision that uses it
    risk: str  # reason for influence and consequence
    answer: str
    rests_on: tuple[str, ...]  # names of shared evidence of the model
    evidence: tuple[Evidence, ...]  # evidence of this claim alone
    goal: str = ""  # goal that was set before the prediction; "" for none
    adequate_for: str
    not_adequate_for: str
    what_would_change_it: str
    numbers: dict[str, Quotation] = {}


class Headline(_Strict):
    """One headline number, and what a reader must know to use it."""

    what: str
    study: str
    number: Quotation
    condition: str
    robot: str
    packets: str
    motion: str
    null: str  # what a model that knows less gives
    what_would_change_it: str


class _StudyFile(_Strict):
    claim: tuple[Claim, ...]


class _ModelFile(_Strict):
    about: tuple[str, ...]  # first paragraphs of the page
    headline: tuple[Headline, ...]
    evidence: tuple[ModelEvidence, ...]


_F = TypeVar("_F", bound=_Strict)


def _read(model: type[_F], path: Path) -> _F:
    try:
        return model.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, ValidationError) as error:
        raise UserError(f"{path}: {error}") from None


@cache
def of_study(name: str) -> tuple[Claim, ...]:
    """Return the claims of a study; none if it has no file. Raises UserError."""
    path = FOLDER / f"{name}.toml"
    return _read(_StudyFile, path).claim if path.is_file() else ()


@cache
def _model_file() -> _ModelFile:
    return _read(_ModelFile, FOLDER / "model.toml")


def of_model() -> dict[str, ModelEvidence]:
    """Return the shared evidence, by its name. Raises UserError."""
    return {row.name: row for row in _model_file().evidence}


# --- numbers of findings in sentences ---

ABSENT = "(not in these findings)"
NOT_PREDICTED = "(not predicted)"
"""Text for a line without a prediction, for example because a recording is not in the
repository.
"""
_UNITS = {"1/h": "an hour", "per hour": "an hour"}


class Quoted(NamedTuple):
    """A number in words."""

    text: str
    over: str = ABSENT  # what it was counted over
    published: str = ABSENT
    band: str = ABSENT  # band of agreement

    def __format__(self, spec: str) -> str:
        return format(self.text, spec)


def filled(text: str, numbers: Mapping[str, Quotation], record: Record | None) -> str:
    """Return the text with its numbers filled in. Without findings, each number is marked as
    absent.
    """
    return text.format_map({name: quoted(one, record) for name, one in numbers.items()})


def quoted(one: Quotation, record: Record | None) -> Quoted:
    """Return the number that the findings have at a place."""
    if record is None:
        return Quoted(ABSENT)
    if one.target:
        found = [state for state in standings(record["lines"]) if state.id == one.target]
        return Quoted(found[0].sentence if found else ABSENT)
    if one.inside:
        passed = [line["passed"] for line in _matching(one.inside, record["lines"], "quantity")]
        judged = [one for one in passed if one is not None]
        return Quoted(f"{sum(judged)} of {len(judged)}" if judged else NOT_PREDICTED)
    if one.table:
        return Quoted(_cell(one, record))
    lines = _matching(one.line, record["lines"], "quantity")
    if len(lines) != 1:
        return Quoted(ABSENT)
    predicted, published, band = (lines[0][key] for key in ("predicted", "published", "band"))
    unit = str(_UNITS.get(lines[0]["unit"], lines[0]["unit"]))
    return Quoted(
        NOT_PREDICTED if predicted is None else cells.with_interval(predicted, unit),
        NOT_PREDICTED if predicted is None else cells.counted_over(predicted),
        ABSENT if published is None else cells.with_interval(published, unit),
        ABSENT if band is None else cells.span(*band),
    )


def _cell(one: Quotation, record: Record) -> str:
    tables = _matching(one.table, record["tables"], "title")
    if len(tables) != 1:
        return ABSENT
    columns = [k for k, name in enumerate(tables[0]["columns"]) if fits(one.column, name)]
    rows = [row for row in tables[0]["rows"] if all(map(fits, one.row, map(cells.cell, row)))]
    return cells.cell(rows[0][columns[0]]) if len(columns) == len(rows) == 1 else ABSENT


def _matching(pattern: str, rows: Sequence[Record], key: str) -> list[Record]:
    return [row for row in rows if fits(pattern, row[key])]


def fits(pattern: str, text: str) -> bool:
    """Return whether a text matches the pattern, in which * stands for any text."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), text, re.DOTALL) is not None


# --- Markdown ---


def section(record: Record) -> str:
    """Return the claims of one study for its own page; "" if it has none."""
    rows = of_study(record["study"]["name"])
    about = (
        "In the order of FDA's guidance on the credibility of computational models (November"
        " 2023). What is said *of the model* is in credibility.md of the folder above."
    )
    return "\n\n".join(["## Credibility", about, *_claims(rows, record, "")]) if rows else ""


def page(records: Mapping[str, Record], home: str = "") -> str:
    """Return the page over studies. `records`: by their names in the order of the page.

    `home`: folder of the page in the repository. With it, pages of docs/ become links; without it,
    code.
    """
    in_short = [
        (
            f"[{claim.title}](#{anchor(claim.title)})",
            filled(claim.answer, claim.numbers, record),
            f"{claim.influence}, {claim.consequence}",
        )
        for name, record in records.items()
        for claim in of_study(name)
    ]
    parts = [
        "# How credible each claim is",
        *_model_file().about,
        "## Claims in short",
        cells.table(("claim about", "answer", "influence, consequence"), in_short),
        "## Headline numbers",
        cells.table(HEADLINE_COLUMNS, (_headline(one, records) for one in _model_file().headline)),
        "## The model",
        "What several claims rest on. *Bench test* is a comparison with recordings of a robot in a"
        " laboratory, or with published experiments on one.",
        _model(records, home),
    ]
    for name, record in records.items():
        if rows := of_study(name):
            parts += [
                f"## {record['study']['title']}",
                f"`ravenjax reproduce {name}`; source: {record['study']['source']}.",
                *_claims(rows, record, home),
            ]
    return "\n\n".join(parts) + "\n"


HEADLINE_COLUMNS = (
    *("number", "value and interval", "independent units", "condition", "robot", "packets"),
    *("motion", "null", "what would change it"),
)


def _headline(one: Headline, records: Mapping[str, Record]) -> tuple[str, ...]:
    found = quoted(one.number, records.get(one.study))
    return (
        *(one.what, found.text, found.over, one.condition, one.robot, one.packets, one.motion),
        *(one.null, one.what_would_change_it),
    )


def answers(record: Record) -> list[str]:
    """Return one line per claim of a study: title, answer, and what the answer is not
    adequate for.
    """
    return [
        f"{claim.title}: {filled(claim.answer, claim.numbers, record)} Not adequate for "
        f"{filled(claim.not_adequate_for, claim.numbers, record)}"
        for claim in of_study(record["study"]["name"])
    ]


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as the documentation's site and GitHub make it if headings
    are unique.
    """
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def _model(records: Mapping[str, Record], home: str) -> str:
    ordered = sorted(of_model().values(), key=lambda one: CATEGORIES.index(one.category))
    rows = []
    for one in ordered:
        record = records.get(one.study) if one.study else None
        text = filled(one.text, one.numbers, record) + _pointers(one, record, home, one.study)
        rows.append((one.category, f"*{one.name}*", text))
    rows.append(("no evidence", "", _lacking(ordered)))
    return cells.table(("category", "name", "evidence"), rows)


def _claims(rows: Iterable[Claim], record: Record, home: str) -> Iterator[str]:
    for claim in rows:
        yield f"### {claim.title}"
        yield f"**{filled(claim.answer, claim.numbers, record)}**"
        yield cells.table(("step", "here"), _steps(claim, record, home))


def _steps(claim: Claim, record: Record, home: str) -> Iterator[tuple[str, str]]:
    def text(of: str) -> str:
        return filled(of, claim.numbers, record)

    yield "Question of interest", claim.question
    yield "Context of use", claim.context_of_use
    risk = f"Influence {claim.influence}, consequence {claim.consequence}. {text(claim.risk)}"
    yield "Model risk", risk
    shared = [of_model()[name] for name in claim.rests_on]
    for category in CATEGORIES:
        names = [f"*{one.name}*" for one in shared if one.category == category]
        parts = [f"Of the model: {', '.join(names)}."] if names else []
        parts += [
            text(one.text) + _pointers(one, record, home)
            for one in claim.evidence
            if one.category == category
        ]
        if parts:
            yield f"Evidence: {category}", " ".join(parts)
    yield "No evidence", _lacking([*shared, *claim.evidence]).capitalize() + "."
    yield "Credibility goal", text(claim.goal) or "None was set beforehand."
    yield (
        "Adequacy",
        f"Adequate for {text(claim.adequate_for)} **Not adequate for"
        f" {text(claim.not_adequate_for)}**",
    )
    yield "What would change it", text(claim.what_would_change_it)


def _lacking(rows: Iterable[Evidence]) -> str:
    present = {one.category for one in rows}
    return ", ".join(category for category in CATEGORIES if category not in present)


def _pointers(one: Evidence, record: Record | None, home: str, study: str = "") -> str:
    where = f" of `ravenjax reproduce {study}`" if study else ""
    tables = []
    for pattern in one.tables:
        found = _matching(pattern, record["tables"], "title") if record else []
        title = found[0]["title"] if len(found) == 1 else pattern.replace("*", "..")
        tables.append(f"table *{title}*{where}")
    tests, pages = [f"`{test}`" for test in one.tests], [_link(page, home) for page in one.pages]
    return f" ({'; '.join([*tests, *pages, *tables])})"


def _link(page: str, home: str) -> str:
    path, _, place = page.partition("#")
    if not (home.startswith("docs") and path.startswith("docs")):
        return f"`{page}`"
    name = posixpath.basename(path).removesuffix(".md")
    return f"[{name}]({posixpath.relpath(path, home)}{'#' * bool(place)}{place})"
