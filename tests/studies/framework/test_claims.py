"""What studies claim: each study has a claim, each pointer leads somewhere, each number comes
from the findings.
"""

from __future__ import annotations

import json
import re
from functools import cache

import pytest

from ravenjax.bundled import resources
from studies import catalogue
from studies.framework import claims, credibility, quoting, writing

ROOT = resources.bundled("campaigns", "quick.toml")[0].parents[1]
REFERENCE = ROOT / "results/reference"
OF_MODEL = list(claims.of_model().values())
CLAIMS = [(name, claim) for name in catalogue.NAMES for claim in claims.of_study(name)]
EVIDENCE = [(one.study, one) for one in OF_MODEL] + [
    (name, one) for name, claim in CLAIMS for one in claim.evidence
]
TEXTS = [pytest.param(one.study, one.text, one.numbers, id=one.name) for one in OF_MODEL] + [
    pytest.param(name, text, claim.numbers, id=f"{claim.title}: {k}")
    for name, claim in CLAIMS
    for k, text in enumerate(claim.texts())
]
FREE = re.compile(r"\b(19|20)\d\d\b|\bjoints 1-3\b|\b4 x 4\b|\b\d+ (mm|ms) (late|from the axis)\b")
"""Numbers that are no finding: years, joints, sizes of matrices, what a variant is."""


@cache
def record(study):
    path = REFERENCE / study / "findings.json"
    assert path.is_file(), (
        f"no findings of {study}: `ravenjax reproduce {study} --keep results/reference`"
    )
    return json.loads(path.read_text(encoding="utf-8"))


def labels(numbers):
    """Words of the places that numbers are read from."""
    return " ".join(
        " ".join((one.line, one.table, *one.row, one.column, one.target, one.inside))
        for one in numbers.values()
    )


@pytest.mark.parametrize("name", catalogue.NAMES)
def test_every_study_claims_something(name):
    assert claims.of_study(name), (
        f"write ravenjax/studies/claims/{name}.toml, as its neighbours are"
    )


def test_every_file_is_of_a_study():
    names = {path.stem for path in claims.FOLDER.glob("*.toml")}
    assert names == {*catalogue.NAMES, claims.MODEL}


def test_categories_are_the_guidances_eight():
    assert len(claims.CATEGORIES) == 8 and claims.CATEGORIES[0] == "code verification"
    order = [claims.CATEGORIES.index(one.category) for one in OF_MODEL]
    assert order == sorted(order)


def test_no_two_claims_have_one_anchor():
    titles = [credibility.anchor(claim.title) for _, claim in CLAIMS]
    assert len(set(titles)) == len(titles)


@pytest.mark.parametrize("name", [one.name for one in OF_MODEL])
def test_some_claim_rests_on_it(name):
    assert any(name in claim.rests_on for _, claim in CLAIMS)


@pytest.mark.parametrize("test", sorted({test for _, one in EVIDENCE for test in one.tests}))
def test_tests_exist(test):
    path, _, name = test.partition("::")
    assert path.startswith(("tests/", "analysis/")) and (ROOT / path).is_file()
    assert not name or re.search(rf"^def {name}\(", (ROOT / path).read_text(encoding="utf-8"), re.M)


@pytest.mark.parametrize("page", sorted({page for _, one in EVIDENCE for page in one.pages}))
def test_pages_and_their_headings_exist(page):
    path, _, place = page.partition("#")
    headings = re.findall(r"^#+ (.*)$", (ROOT / path).read_text(encoding="utf-8"), re.M)
    assert not place or place in map(credibility.anchor, headings)


@pytest.mark.parametrize(
    ("study", "title"), sorted({(study, title) for study, one in EVIDENCE for title in one.tables})
)
def test_tables_exist(study, title):
    titles = [table["title"] for table in record(study)["tables"]]
    assert len(quoting.matching(title, record(study)["tables"], "title")) == 1, titles


@pytest.mark.parametrize(("study", "text", "numbers"), TEXTS)
def test_numbers_are_in_the_findings(study, text, numbers):
    words = quoting.filled(text, numbers, record(study) if study else None)
    assert quoting.ABSENT not in words and quoting.NOT_PREDICTED not in words, words


@pytest.mark.parametrize(("study", "text", "numbers"), TEXTS)
def test_no_number_is_typed(study, text, numbers):
    """A number outside braces is part of a name: the line or cell that is quoted says it, too."""
    typed = re.findall(
        r"(?<![\w.,])\d[\d.,]*\d|(?<![\w.,])\d", FREE.sub("", re.sub(r"\{.*?\}", "", text))
    )
    names = labels(numbers)
    assert [
        number for number in typed if not re.search(rf"(?<!\d){re.escape(number)}(?!\d)", names)
    ] == []


def test_the_page_of_the_documentation_is_that_of_the_kept_findings():
    page = ROOT / "docs/explanation/credibility.md"
    kept = REFERENCE / credibility.NAME
    text = credibility.page(writing.records(REFERENCE, catalogue.NAMES), "docs/explanation")
    command = f"ravenjax credibility results/reference --out {page.relative_to(ROOT)}"
    assert page.read_text(encoding="utf-8") == text, f"write it anew: {command}"
    if kept.is_file():
        text = credibility.page(writing.records(REFERENCE, catalogue.NAMES))
        assert kept.read_text(encoding="utf-8") == text, (
            f"write it anew: {command.partition(' --out')[0]} --out {kept}"
        )
