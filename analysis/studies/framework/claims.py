"""What each study claims and what that rests on, as data: `studies/claims/NAME.toml`, one file a
study.

Terms and their order are those of the guidance *Assessing the Credibility of Computational Modeling
and Simulation in Medical Device Submissions* (FDA, November 2023). What several claims rest on
stands once, in `claims/model.toml`.

A text may hold numbers of findings, each by its name in braces. `numbers` says where it is read, so
that none is typed:

    answer = "The predicted mean is {mean}, over {mean.over}; published is {mean.published}."
    numbers.mean = { line = "mean tip error of all segments" }

In patterns of a line's quantity, a table's title, a row or a column, * stands for any text.
"""

from __future__ import annotations

import string
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ravenjax.errors import UserError
from studies.framework import toml_record

FOLDER = Path(__file__).parents[1] / "claims"
MODEL = "model"
"""Name of the file of what several claims rest on."""

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
    """Where a number of findings is read: one of a line, a cell, a target, or lines inside their
    bands.
    """

    line: str = Field(default="", description="quantity of a line")
    table: str = Field(default="", description="title of a table; with row and column")
    row: tuple[str, ...] = Field(default=(), description="first cells of the row")
    column: str = ""
    target: str = Field(default="", description="A1: what its lines say")
    inside: str = Field(
        default="", description="quantities of lines, of which those inside their band are counted"
    )

    @model_validator(mode="after")
    def _one_place(self) -> Quotation:
        if sum(map(bool, (self.line, self.table, self.target, self.inside))) != 1:
            raise ValueError("give one of line, table, target, inside")
        if bool(self.table) != bool(self.row and self.column):
            raise ValueError("give table, row and column together")
        return self


class Evidence(_Strict):
    """Something that speaks for or against, and where to look at it."""

    category: Category
    text: str = Field(min_length=1)
    tests: tuple[str, ...] = Field(
        default=(), description="tests/... or analysis/..., a test's name behind ::"
    )
    pages: tuple[str, ...] = Field(
        default=(), description="docs/... or models/..., a heading's anchor behind #"
    )
    tables: tuple[str, ...] = Field(
        default=(), description="titles of tables of the study's findings"
    )

    @model_validator(mode="after")
    def _points_somewhere(self) -> Evidence:
        if not (self.tests or self.pages or self.tables):
            raise ValueError("give tests, pages or tables: where to look at it")
        return self


class ModelEvidence(Evidence):
    """What several claims rest on."""

    name: str = Field(min_length=1, description="by which claims name it")
    study: str = Field(default="", description="whose findings its tables and numbers are of")
    numbers: dict[str, Quotation] = {}

    @model_validator(mode="after")
    def _numbers_are_those_of_the_text(self) -> ModelEvidence:
        _require_quoted((self.text,), self.numbers)
        if (self.tables or self.numbers) and not self.study:
            raise ValueError("give the study that its tables and numbers are of")
        return self


class Claim(_Strict):
    """One answer of a study, in the guidance's order, and what would change it."""

    title: str = Field(min_length=1, description="what is claimed about, without its number")
    question: str = Field(min_length=1, description="question of interest")
    context_of_use: str = Field(min_length=1, description="what the model is used for to answer it")
    influence: Level = Field(description="of the model, beside other evidence, on the answer")
    consequence: Level = Field(description="of a wrong answer, for the decision that rests on it")
    risk: str = Field(min_length=1, description="why influence and consequence are so")
    answer: str = Field(min_length=1)
    rests_on: tuple[str, ...] = Field(min_length=1, description="names of evidence of the model")
    evidence: tuple[Evidence, ...] = Field(min_length=1, description="of this claim alone")
    goal: str = Field(
        default="", description="what was set before the prediction was made; empty for nothing"
    )
    adequate_for: str = Field(min_length=1)
    not_adequate_for: str = Field(min_length=1)
    what_would_change_it: str = Field(min_length=1)
    numbers: dict[str, Quotation] = {}

    def texts(self) -> Iterator[str]:
        """Every text that may hold numbers."""
        yield from (self.answer, self.risk, self.goal, self.adequate_for, self.not_adequate_for)
        yield self.what_would_change_it
        yield from (one.text for one in self.evidence)

    @model_validator(mode="after")
    def _numbers_are_those_of_the_texts(self) -> Claim:
        _require_quoted(self.texts(), self.numbers)
        return self


class _StudyFile(_Strict):
    claim: tuple[Claim, ...] = Field(min_length=1)


class _ModelFile(_Strict):
    about: tuple[str, ...] = Field(min_length=1)  # paragraphs
    evidence: tuple[ModelEvidence, ...] = Field(min_length=1)


def of_study(name: str) -> tuple[Claim, ...]:
    """The claims of a study; none where it has no file. Raises UserError for a file that is not
    as described above.
    """
    path = FOLDER / f"{name}.toml"
    return parse(path.read_text(encoding="utf-8"), str(path)) if path.is_file() else ()


def parse(text: str, where: str) -> tuple[Claim, ...]:
    """As `of_study`, of a file's text; `where` names it in errors."""
    claims = toml_record.read(_StudyFile, text, where).claim
    for claim in claims:
        if unknown := [name for name in claim.rests_on if name not in of_model()]:
            raise UserError(
                f"{where}: claim {claim.title!r} rests on {', '.join(unknown)};"
                f" {FOLDER / MODEL}.toml has {', '.join(of_model())}"
            )
    return claims


def of_model() -> dict[str, ModelEvidence]:
    """What several claims rest on, by its name. Raises UserError."""
    return {row.name: row for row in _model_file().evidence}


def about() -> tuple[str, ...]:
    """Paragraphs that say what the page is and is not. Raises UserError."""
    return _model_file().about


@cache
def _model_file() -> _ModelFile:
    path = FOLDER / f"{MODEL}.toml"
    return toml_record.read(_ModelFile, path.read_text(encoding="utf-8"), str(path))


def placeholders(text: str) -> list[str]:
    """Names in braces: `mean`, `mean.over`."""
    return [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]


def _require_quoted(texts: Iterator[str] | tuple[str, ...], numbers: dict[str, Quotation]) -> None:
    names = {name.partition(".")[0] for text in texts for name in placeholders(text)}
    if missing := sorted(names - numbers.keys()):
        raise ValueError(f"numbers has no {', '.join(missing)}")
    if idle := sorted(numbers.keys() - names):
        raise ValueError(f"no text has {', '.join(f'{{{name}}}' for name in idle)}")
