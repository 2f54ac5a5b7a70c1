"""Claims as text: the guidance's order, numbers of the findings, and what is missing said to be
missing.
"""

from __future__ import annotations

import json
import re

import pytest
from fake_study import FINDINGS, MADE, STUDY

from ravenjax.cli import main
from ravenjax.errors import UserError
from studies import catalogue
from studies.framework import claims, credibility, quoting, writing
from studies.framework.claims import Quotation
from studies.framework.study import plain

ONE = """
[[claim]]
title = "A mean"
question = "Is it so?"
context_of_use = "For a test."
influence = "high"
consequence = "low"
risk = "Nothing rests on it."
answer = "It is {mean} over {mean.over}; published {mean.published}, band {mean.band}; {target}; {setting} mm."
rests_on = ["engines"]
goal = "{inside} inside."
adequate_for = "a test."
not_adequate_for = "anything else."
what_would_change_it = "Another test."
numbers.mean = { line = "mean" }
numbers.target = { target = "A6" }
numbers.inside = { inside = "*" }
numbers.setting = { table = "Sett*", row = ["a"], column = "mm" }
[[claim.evidence]]
category = "model plausibility"
text = "Later in the order."
pages = ["docs/outcomes.md"]
[[claim.evidence]]
category = "model calibration"
text = "Earlier."
tables = ["Sett*"]
"""  # noqa: E501
RECORD = {"study": {"name": "fake", "title": "A fake", "source": "Nobody"}, **plain(FINDINGS)}


@pytest.fixture
def fake_claims(monkeypatch, tmp_path):
    (tmp_path / "claims").mkdir()
    (tmp_path / "claims/fake.toml").write_text(ONE, encoding="utf-8")
    claims.of_model()  # of the package's folder, which is read once
    monkeypatch.setattr(claims, "FOLDER", tmp_path / "claims")


def steps(text):
    return re.findall(r"^\| ([^|]+?) \|", text.partition("### A mean")[2], re.M)[1:]


def test_a_claim_is_told_in_the_guidances_order_with_the_numbers_of_the_findings(fake_claims):
    text = credibility.page({"fake": RECORD})
    assert steps(text) == [
        "Question of interest",
        "Context of use",
        "Model risk",
        "Evidence: code verification",
        "Evidence: model calibration",
        "Evidence: model plausibility",
        "No evidence",
        "Credibility goal",
        "Adequacy",
        "What would change it",
    ]
    answer = "It is 0.506 mm over 12,345 runs; published 0.8 mm, band 0.7 to 2.5; "
    answer += "A6 not met: 1 of 2 lines inside their band; 1.25 mm."
    assert text.count(answer) == 2, "in short and in full"
    assert "| Model risk | Influence high, consequence low. Nothing rests on it. |" in text
    assert "| Evidence: code verification | Of the model: *engines*. |" in text
    assert (
        "Earlier. (table *Settings*)" in text and "Later in the order. (`docs/outcomes.md`)" in text
    )
    assert (
        "| No evidence | Bench test validation, in vivo validation, population-based validation, "
        in text
    )
    assert "| Credibility goal | 2 of 3 inside. |" in text
    assert "[A mean](#a-mean)" in text


def test_other_findings_give_other_numbers(fake_claims):
    other = json.loads(json.dumps(RECORD))
    line = next(line for line in other["lines"] if line["quantity"] == "mean")
    line["predicted"] |= {"value": 1.5, "low": 1.25, "high": 2.0}
    line["passed"] = True
    answers = credibility.answers(other)
    assert (
        len(answers) == 1
        and "It is 1.5 mm (1.25 to 2)" in answers[0]
        and "A6 met: 2 of 2 lines" in answers[0]
    )
    assert answers[0].startswith("A mean: ") and answers[0].endswith(
        "Not adequate for anything else."
    )


def test_pages_of_the_documentation_become_links_on_one_of_them(fake_claims):
    assert "([outcomes](../outcomes.md))" in credibility.page({"fake": RECORD}, "docs/explanation")


def test_a_study_without_claims_has_no_section():
    assert credibility.section(RECORD) == "" and credibility.answers(RECORD) == []
    assert credibility.section(
        {"study": {"name": "detectors"}, "lines": [], "tables": []}
    ).startswith("## Credibility")


def test_the_studys_own_page_has_its_claims(fake_claims, tmp_path):
    writing.write(STUDY, FINDINGS, MADE, tmp_path / "fake")
    page = (tmp_path / "fake/findings.md").read_text(encoding="utf-8")
    assert (
        page.index("## Settings") < page.index("## Credibility") < page.index("## How it was made")
    )
    assert "It is 0.506 mm over 12,345 runs" in page
    assert "It is 0.506 mm" in (tmp_path / "fake/findings.html").read_text(encoding="utf-8")
    whole = writing.write_credibility(tmp_path, ["fake", "not_run"])
    assert whole == tmp_path / "credibility.md" and "It is 0.506 mm" in whole.read_text(
        encoding="utf-8"
    )


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ({"line": "mean"}, "0.506 mm"),
        ({"line": "peak*"}, "1.5 mm (1.25 to 1.75)"),
        ({"line": "not measured"}, quoting.NOT_PREDICTED),
        ({"line": "*"}, quoting.ABSENT),
        ({"line": "nothing"}, quoting.ABSENT),
        ({"target": "A5"}, "A5 not judged: no line of it with a band has a prediction"),
        ({"target": "A1"}, quoting.ABSENT),
        ({"inside": "mean"}, "0 of 1"),
        ({"inside": "not measured"}, quoting.NOT_PREDICTED),
        ({"table": "Settings", "row": ["c"], "column": "mm"}, "3"),
        ({"table": "Settings", "row": ["*"], "column": "mm"}, quoting.ABSENT),
        ({"table": "Settings", "row": ["a"], "column": "cm"}, quoting.ABSENT),
        ({"table": "Other", "row": ["a"], "column": "mm"}, quoting.ABSENT),
    ],
)
def test_what_is_quoted_is_one_place_or_said_to_be_absent(place, words):
    assert str(quoting.quoted(Quotation.model_validate(place), RECORD)) == words
    assert str(quoting.quoted(Quotation.model_validate(place), None)) == quoting.ABSENT


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"engines"', '"hearsay"', "rests on hearsay"),
        ('"model plausibility"', '"authority"', "claim.0.evidence.0.category"),
        ('pages = ["docs/outcomes.md"]\n', "", "give tests, pages or tables"),
        (
            '{ line = "mean" }',
            '{ line = "mean", target = "A6" }',
            "give one of line, table, target, inside",
        ),
        (', row = ["a"]', "", "give table, row and column together"),
        ("{setting} mm", "1.25 mm", "no text has {setting}"),
        ("{setting}", "{settings}", "numbers has no settings"),
        ('influence = "high"', 'influence = "some"', "claim.0.influence"),
        ('question = "Is it so?"\n', "", "claim.0.question"),
        ("[[claim]]", "[claim", "not valid TOML"),
    ],
)
def test_a_file_that_is_not_so_is_refused_with_its_place(old, new, words):
    assert old in ONE and len(claims.parse(ONE, "here.toml")) == 1
    with pytest.raises(UserError, match=re.escape(words)) as error:
        claims.parse(ONE.replace(old, new, 1), "here.toml")
    assert str(error.value).startswith("here.toml")


def test_the_command_tells_it_of_a_folder(tmp_path, capsys):
    assert main(["credibility", str(tmp_path)]) == 2
    assert "ravenjax reproduce" in capsys.readouterr().err
    record = RECORD | {"study": RECORD["study"] | {"name": "detectors"}}
    (tmp_path / "detectors").mkdir()
    (tmp_path / "detectors/findings.json").write_text(json.dumps(record), encoding="utf-8")
    assert main(["credibility", str(tmp_path), "--out", str(tmp_path / "page.md")]) == 0
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "### Which detector tells an unintended motion" in page and quoting.ABSENT in page


def test_reproducing_prints_answers_and_writes_the_page_over_all_studies(
    fake_claims, monkeypatch, tmp_path, capsys
):
    monkeypatch.setattr(catalogue, "NAMES", {"fake": "fake"})
    monkeypatch.setattr(catalogue, "find", lambda name: STUDY)
    out, keep = tmp_path / "out", tmp_path / "keep"
    assert main(["reproduce", "all", "--out", str(out), "--keep", str(keep)]) == 0
    printed = capsys.readouterr().out
    assert (
        "- A mean: It is 0.506 mm" in printed
        and f"credibility: {keep / credibility.NAME}" in printed
    )
    page = (keep / credibility.NAME).read_text(encoding="utf-8")
    assert page == (out / credibility.NAME).read_text(encoding="utf-8") and "### A mean" in page
