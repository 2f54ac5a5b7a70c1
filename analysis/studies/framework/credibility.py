"""What each claim rests on, as Markdown, in the order of the guidance that `claims` names: a
section of a study's page, and one page over all studies."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from studies.framework import cells, claims, quoting
from studies.framework.claims import Claim, Evidence, ModelEvidence

Record = Mapping[str, Any]

NAME = "credibility.md"
COLUMNS = ("step", "here")


def section(record: Record) -> str:
    """The claims of one study, for its own page; empty where it has none."""
    rows = claims.of_study(record["study"]["name"])
    return "\n\n".join(["## Credibility", _OF_ONE, *_claims(rows, record, "")]) if rows else ""


def page(records: Mapping[str, Record], home: str = "") -> str:
    """The page over studies, by their names in the order of the page.

    home: folder of the page in the repository; pages of docs/ are then links, and code otherwise.
    """
    parts = [
        "# How credible each claim is",
        *claims.about(),
        "## Claims in short",
        _summary(records),
        "## The model",
    ]
    parts += [_OF_MODEL, _model(records, home)]
    for name, record in records.items():
        if rows := claims.of_study(name):
            study = record["study"]
            parts += [
                f"## {study['title']}",
                f"`ravenjax reproduce {name}`; source: {study['source']}.",
            ]
            parts += _claims(rows, record, home)
    return "\n\n".join(parts) + "\n"


def answers(record: Record) -> list[str]:
    """One line for each claim of a study: what it is about, its answer, what that is not
    adequate for.
    """
    return [
        f"{claim.title}: {_of(claim.answer, claim, record)} Not adequate for "
        f"{_of(claim.not_adequate_for, claim, record)}"
        for claim in claims.of_study(record["study"]["name"])
    ]


def anchor(heading: str) -> str:
    """Of a heading, as the documentation's site and GitHub make it where no two headings are
    alike.
    """
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def _summary(records: Mapping[str, Record]) -> str:
    rows = [
        (
            f"[{claim.title}](#{anchor(claim.title)})",
            _of(claim.answer, claim, record),
            f"{claim.influence}, {claim.consequence}",
        )
        for name, record in records.items()
        for claim in claims.of_study(name)
    ]
    return cells.table(("claim about", "answer", "influence, consequence"), rows)


def _model(records: Mapping[str, Record], home: str) -> str:
    def sentence(one: ModelEvidence) -> str:
        record = records.get(one.study) if one.study else None
        return quoting.filled(one.text, one.numbers, record) + _pointers(
            one, record, home, one.study
        )

    ordered = sorted(
        claims.of_model().values(), key=lambda one: claims.CATEGORIES.index(one.category)
    )
    rows = [(one.category, f"*{one.name}*", sentence(one)) for one in ordered]
    return cells.table(
        ("category", "name", "evidence"), [*rows, ("no evidence", "", _lacking(ordered))]
    )


def _claims(rows: tuple[Claim, ...], record: Record, home: str) -> Iterator[str]:
    for claim in rows:
        yield f"### {claim.title}"
        yield f"**{_of(claim.answer, claim, record)}**"
        yield cells.table(COLUMNS, _steps(claim, record, home))


def _steps(claim: Claim, record: Record, home: str) -> Iterator[tuple[str, str]]:
    yield "Question of interest", claim.question
    yield "Context of use", claim.context_of_use
    yield (
        "Model risk",
        (
            f"Influence {claim.influence}, consequence {claim.consequence}."
            f" {_of(claim.risk, claim, record)}"
        ),
    )
    shared = [claims.of_model()[name] for name in claim.rests_on]
    for category in claims.CATEGORIES:
        names = [f"*{one.name}*" for one in shared if one.category == category]
        own = [
            _of(one.text, claim, record) + _pointers(one, record, home)
            for one in claim.evidence
            if one.category == category
        ]
        if names or own:
            general = [f"Of the model: {', '.join(names)}."] if names else []
            yield f"Evidence: {category}", " ".join(general + own)
    yield "No evidence", _lacking([*shared, *claim.evidence]).capitalize() + "."
    yield "Credibility goal", _of(claim.goal, claim, record) or "None was set beforehand."
    yield (
        "Adequacy",
        (
            f"Adequate for {_of(claim.adequate_for, claim, record)} "
            f"**Not adequate for {_of(claim.not_adequate_for, claim, record)}**"
        ),
    )
    yield "What would change it", _of(claim.what_would_change_it, claim, record)


def _lacking(rows: Iterable[Evidence]) -> str:
    present = {one.category for one in rows}
    return ", ".join(category for category in claims.CATEGORIES if category not in present)


def _of(text: str, claim: Claim, record: Record) -> str:
    return quoting.filled(text, claim.numbers, record)


def _pointers(one: Evidence, record: Record | None, home: str, study: str = "") -> str:
    where = f" of `ravenjax reproduce {study}`" if study else ""
    tests, pages = [f"`{test}`" for test in one.tests], [_link(page, home) for page in one.pages]
    tables = [f"table *{_title(pattern, record)}*{where}" for pattern in one.tables]
    return f" ({'; '.join([*tests, *pages, *tables])})"


def _title(pattern: str, record: Record | None) -> str:
    tables = quoting.matching(pattern, record["tables"], "title") if record else []
    return tables[0]["title"] if len(tables) == 1 else pattern.replace("*", "..")


def _link(page: str, home: str) -> str:
    path, _, place = page.partition("#")
    if not (home.startswith("docs") and path.startswith("docs")):
        return f"`{page}`"
    name = posixpath.basename(path).removesuffix(".md")
    return f"[{name}]({posixpath.relpath(path, home)}{'#' * bool(place)}{place})"


_OF_ONE = (
    "In the order of FDA's guidance on the credibility of computational models (November 2023)."
    f" What is said *of the model* is in {NAME} of the folder above."
)
_OF_MODEL = (
    "What several claims rest on. *Bench test* is a comparison with recordings of a robot in a"
    " laboratory, or with published experiments on one."
)
