"""Findings on disk: readable, valid, the same bytes each time, nothing of the machine or the
hour.
"""

from __future__ import annotations

import json

import pytest
from fake_study import FINDINGS, MADE, STUDY

from ravenjax.errors import StoreError
from studies.framework import markdown, writing
from studies.framework.provenance import shown_override
from studies.framework.study import Findings, plain


@pytest.fixture
def written(tmp_path):
    writing.write(STUDY, FINDINGS, MADE, tmp_path / "fake")
    return tmp_path / "fake"


def test_all_files_are_there(written):
    assert sorted(path.name for path in written.iterdir()) == [
        "findings.html",
        "findings.json",
        "findings.md",
        "first.pdf",
        "first.svg",
    ]


def test_the_page_holds_text_tables_and_drawings_in_one_file(written):
    page = (written / "findings.html").read_text()
    assert "<h1>A fake</h1>" in page and ">Settings</caption>" in page and "first.svg" not in page
    assert 'aria-label="What it shows."' in page and ">predicted</text>" in page
    assert (
        "A6 not met: 1 of 2 lines inside their band" in page
        and "A4 met: 1 of 1 line inside its band" in page
    )
    assert "<td>0.506; 12,345 runs</td>" in page


def test_json_holds_every_number_and_no_nan(written):
    record = json.loads((written / "findings.json").read_text())
    assert record["study"] == {
        "name": "fake",
        "title": "A fake",
        "source": "Nobody, 2026",
        "question": "Is it so?",
        "targets": ["A4", "A5", "A6"],
    }
    lines = {line["quantity"]: line for line in record["lines"]}
    assert lines["mean"]["passed"] is False and lines["slope"]["passed"] is True
    assert lines["not measured"]["passed"] is None and lines["not measured"]["predicted"] is None
    assert lines["mean"]["predicted"] == {
        "value": 0.506,
        "low": None,
        "high": None,
        "n": 12345,
        "of": "runs",
    }
    assert lines["stops"]["band"] == [1, None]
    assert record["tables"][0]["rows"] == [["a", 1.25], ["b", None], ["c", 3]]
    assert record["drawings"] == [{"name": "first", "caption": "What it shows."}]
    campaign = record["provenance"]["campaigns"][0]
    assert campaign["config_hash"] == "ab" * 32 and campaign["seed"] == 7
    assert campaign["command"] == "ravenjax run quick.toml --set campaign.limit=2"


def test_page_says_what_a_reader_wants_to_know(written):
    page = (written / "findings.md").read_text()
    assert page.startswith("# A fake\n\nIs it so?")
    assert (
        "**A6 not met: 1 of 2 lines inside their band. A4 met: 1 of 1 line inside its band. A5 not"
        " judged: " in page
    )
    assert (
        "- A6: tip error without a fault at teleoperation scales of 0.05 to 0.2 (IROS 2016, Figure"
        " 3). Band: " in page
    )
    assert "| A6: mean, mm | 0.8 | 0.506; 12,345 runs | 0.7 to 2.5 | NO | it is colder |" in page
    assert (
        r"| peak \| first, mm | 2.1 (2 to 2.2); Figure 1 | 1.5 (1.25 to 1.75); 9 motions |  |  |  |"
        in page
    )
    assert "| A4: stops | – | 3; 9 runs | at least 1 | yes |  |" in page
    assert "| A5: not measured, s | 0.2 | – | 0.1 to 0.3 |  |  |" in page
    assert "![What it shows.](first.svg)" in page and "## Settings" in page and "| b | – |" in page
    assert (
        "ravenjax reproduce fake" in page
        and "`ravenjax run quick.toml --set campaign.limit=2`" in page
    )
    assert "Engine simd on a CPU; code c0dec0dec0dec0de; python 3.11.7, numpy 2.4.6." in page
    body = [line for line in page.splitlines() if line.startswith("|")]
    assert all(line.replace(r"\|", "").count("|") in (3, 6, 7) for line in body)


def test_drawings_are_text_and_vectors_without_a_date(written):
    svg, pdf = (written / "first.svg").read_text(), (written / "first.pdf").read_bytes()
    assert ">predicted</text>" in svg and "dc:date" not in svg
    assert b"/FontFile2" in pdf and b"CreationDate" not in pdf


def test_the_same_findings_give_the_same_bytes(written, tmp_path):
    writing.write(STUDY, FINDINGS, MADE, tmp_path / "again")
    for path in written.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes(), path.name


def test_kept_findings_are_the_same_without_pictures(written, tmp_path):
    kept = writing.keep(written, tmp_path / "reference" / "fake")
    assert sorted(path.name for path in kept.iterdir()) == ["findings.json", "findings.md"]
    assert (kept / "findings.json").read_bytes() == (written / "findings.json").read_bytes()
    page = (kept / "findings.md").read_text()
    assert "first.svg" not in page and "## Figures" not in page and "## Settings" in page
    assert "## Credibility" not in page, "the page over all studies has it"
    assert str(tmp_path) not in page + (kept / "findings.json").read_text()


def test_nothing_to_keep_is_an_error_that_says_what_to_do(tmp_path):
    with pytest.raises(StoreError, match="ravenjax reproduce"):
        writing.keep(tmp_path / "absent", tmp_path / "kept")


def test_empty_findings_make_a_page(tmp_path):
    writing.write(STUDY, Findings(()), MADE, tmp_path)
    page = (tmp_path / "findings.md").read_text()
    assert "## Published" not in page and "## How it was made" in page


def test_terminal_rows_are_those_of_the_page_without_origins(written):
    rows = markdown.line_rows(FINDINGS)
    assert all(len(row) == len(markdown.BRIEF_COLUMNS) for row in rows)
    assert rows[1] == ("A6: mean, mm", "0.8", "0.506", "0.7 to 2.5", "NO")
    assert len(rows) == len(plain(FINDINGS)["lines"])


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("operator.file=/home/someone/data/motion.parquet", "operator.file=motion.parquet"),
        ('operator.file="/a/b.csv"', "operator.file=b.csv"),
        ("operator.scale=0.1", "operator.scale=0.1"),
        ("campaign.name=a/b", "campaign.name=a/b"),
    ],
)
def test_folders_of_this_machine_are_left_out(given, shown):
    assert shown_override(given) == shown
