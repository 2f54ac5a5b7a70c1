"""Writes what each study claims and which evidence supports it, as Markdown.

The data are in `claims/NAME.toml`, and evidence that several claims share in `claims/model.toml`.
Terms and their order are those of the guidance *Assessing the Credibility of Computational Modeling
and Simulation in Medical Device Submissions* (FDA, November 2023).

A text of a claim contains numbers of the findings by name, in braces. `numbers` states where each
number is read in the findings, so that no number is typed by hand:

    answer = "The predicted mean is {mean}, over {mean.over}; published is {mean.published}."
    numbers.mean = { line = "mean tip error of all segments" }

In patterns for a line's quantity, a table's title, a row or a column, * matches any text.
"""

import posixpath
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict

from ravenjax.errors import UserError
from ravenjax.report import wording
from studies import cells
from studies.study import HERE, read_toml, standings

Record = Mapping[str, Any]
"""Content of findings.json."""

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
    """The place of a number in findings: a line, a cell, a target, or lines that are counted."""

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


class ClaimFile(_Strict):
    """The claims of a study, or what `claims/model.toml` states of the model."""

    claim: tuple[Claim, ...] = ()
    about: tuple[str, ...] = ()  # first paragraphs of the page
    headline: tuple[Headline, ...] = ()
    evidence: tuple[ModelEvidence, ...] = ()


@cache
def read_claims(name: str) -> ClaimFile:
    """Return the content of `claims/NAME.toml`; nothing without this file. Raises UserError."""
    path = HERE / "claims" / f"{name}.toml"
    try:
        return ClaimFile.model_validate(read_toml(str(path)) if path.is_file() else {})
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None


def of_model() -> dict[str, ModelEvidence]:
    """Return the shared evidence, by its name. Raises UserError."""
    return {row.name: row for row in read_claims("model").evidence}


# --- numbers of findings in sentences ---

ABSENT, NOT_PREDICTED = "(not in these findings)", "(not predicted)"
"""Texts for an absent number, and for a line without a prediction (a recording is not at hand)."""
_UNITS = {"1/h": "times per hour", "per hour": "times per hour"}


class Quoted(NamedTuple):
    """A number in words."""

    text: str
    over: str = ABSENT  # what it was counted over
    published: str = ABSENT
    band: str = ABSENT  # band of agreement

    def __format__(self, spec: str) -> str:
        return format(self.text, spec)


def filled(text: str, numbers: Mapping[str, Quotation], record: Record | None) -> str:
    """Return the text with its numbers filled in; without findings they are marked as absent."""
    return text.format_map({name: quoted(place, record) for name, place in numbers.items()})


def quoted(place: Quotation, record: Record | None) -> Quoted:
    """Return the number that the findings have at a place."""
    if record is None:
        return Quoted(ABSENT)
    if place.target:
        return Quoted(standings(record["lines"]).get(place.target, ABSENT))
    if place.table:
        return Quoted(_cell(place, record))
    lines = _matching(place.line or place.inside, record["lines"], "quantity")
    if place.inside:
        judged = [line["passed"] for line in lines if line["passed"] is not None]
        return Quoted(f"{sum(judged)} of {len(judged)}" if judged else NOT_PREDICTED)
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


def _cell(place: Quotation, record: Record) -> str:
    tables = _matching(place.table, record["tables"], "title")
    if len(tables) != 1:
        return ABSENT
    columns = [k for k, name in enumerate(tables[0]["columns"]) if fits(place.column, name)]
    rows = [row for row in tables[0]["rows"] if all(map(fits, place.row, map(cells.cell, row)))]
    return cells.cell(rows[0][columns[0]]) if len(columns) == len(rows) == 1 else ABSENT


def _matching(pattern: str, rows: Sequence[Record], key: str) -> list[Record]:
    return [row for row in rows if fits(pattern, row[key])]


def fits(pattern: str, text: str) -> bool:
    """Return whether a text matches the pattern, in which * stands for any text."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), text, re.DOTALL) is not None


# --- Markdown ---


def section(record: Record) -> str:
    """Return the claims of one study for its own page; "" if it has none."""
    name = record["study"]["name"]
    return page({name: record}, single=True) if read_claims(name).claim else ""


def page(records: Mapping[str, Record], home: str = "", single: bool = False) -> str:
    """Return the page over studies. `records`: by their names in the order of the page. `home`:
    folder of the page in the repository, with which pages of docs/ become links. `single`: return
    the claims of the only study for its own page.
    """
    shared, model = of_model(), read_claims("model")
    return fill_page(
        "credibility.md.j2",
        single=single,
        records=records,
        model=sorted(shared.values(), key=lambda row: CATEGORIES.index(row.category)),
        shared=shared,
        about=model.about,
        headlines=[(row, quoted(row.number, records.get(row.study))) for row in model.headline],
        categories=CATEGORIES,
        claims_of=lambda name: read_claims(name).claim,
        filled=filled,
        anchor=anchor,
        lacking=_lacking,
        pointers=partial(_pointers, home),
    )


def fill_page(template: str, **values: Any) -> str:
    """Return a filled template of this folder as Markdown without repeated empty lines."""
    templates = wording.text_templates("studies")
    templates.filters["escaped"] = cells.escaped
    text = templates.get_template(template).render(values)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def anchor(heading: str) -> str:
    """Return the anchor of a unique heading, as GitHub and the documentation's site make it."""
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def _lacking(rows: Iterable[Evidence], shared: Iterable[str] = ()) -> str:
    present = {row.category for row in (*rows, *map(of_model().__getitem__, shared))}
    return ", ".join(category for category in CATEGORIES if category not in present)


def _pointers(home: str, evidence: Evidence, record: Record | None, study: str = "") -> str:
    """Write the places that show evidence. `study`: whose tables, if not the page's own."""
    where = f" of `ravenjax reproduce {study}`" if study else ""
    tables = []
    for pattern in evidence.tables:
        found = _matching(pattern, record["tables"], "title") if record else []
        title = found[0]["title"] if len(found) == 1 else pattern.replace("*", "..")
        tables.append(f"table *{title}*{where}")
    places = [f"`{test}`" for test in evidence.tests] + [_link(x, home) for x in evidence.pages]
    return f" ({'; '.join([*places, *tables])})"


def _link(page: str, home: str) -> str:
    path, _, place = page.partition("#")
    if not (home.startswith("docs") and path.startswith("docs")):
        return f"`{page}`"
    name = posixpath.basename(path).removesuffix(".md")
    return f"[{name}]({posixpath.relpath(path, home)}{'#' * bool(place)}{place})"
