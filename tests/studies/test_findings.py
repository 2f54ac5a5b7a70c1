"""Running a study, its files, its targets, and the page of claims over all studies."""

import dataclasses
import json
import math

import pytest

import studies
from ravenjax import resources
from ravenjax.campaign import loading
from ravenjax.cli import main
from ravenjax.store import manifest
from studies import claims, findings
from studies.claims import Quotation
from studies.study import Findings, Line, Study, StudyEstimate, Table, Variant, plain, standings

ROOT = resources.list_resources("campaigns", "quick.toml")[0].parents[1]
REFERENCE = ROOT / "results/reference"
FOUND = Findings(
    lines=(
        Line("peak | first", "mm", StudyEstimate(2.1, 2.0, 2.2), StudyEstimate(1.5, 1.25, 1.75, 9)),
        Line(
            "mean",
            "mm",
            StudyEstimate(0.8),
            StudyEstimate(0.506, n=12345, of="runs"),
            (0.7, 2.5),
            "A6",
            "it is colder",
        ),
        Line("slope", "", StudyEstimate(7.2), StudyEstimate(7.0), (6.0, 8.0), "A6"),
        Line("stops", "", None, StudyEstimate(3, n=9, of="runs"), (1, math.inf), "A4"),
        Line("not measured", "s", StudyEstimate(0.2), None, (0.1, 0.3), "A5"),
    ),
    tables=(
        Table("Settings", ("what", "mm"), (("a", 1.25), ("b", math.nan), ("c", 3)), "Below it."),
    ),
    notes=("Nothing was fitted.",),
)
STUDY = Study("fake", "A fake", "Nobody, 2026", "Is it so?", (), lambda context: FOUND, ("A6",))
SHORT = ("campaign.duration_s=0.03", "campaign.limit=2")


def count_runs(context):
    rows = [manifest.read_manifest(folder).done for folder in context.folders.values()]
    return Findings((Line("runs", "", None, StudyEstimate(sum(rows))),))


TWO = dataclasses.replace(
    STUDY,
    compare=count_runs,
    variants=(
        Variant("base", "seed_fault_free.toml", SHORT),
        Variant("faster", "seed_fault_free.toml", (*SHORT, "operator.seed=2"), "another motion"),
    ),
)


@pytest.mark.slow
@pytest.mark.parametrize("name", studies.NAMES)
def test_every_variant_of_a_study_is_a_campaign_of_its_own(name):
    variants = studies.find(name).variants
    assert len({variant.name for variant in variants}) == len(variants)
    for variant in variants:
        if not variant.name.startswith("recorded"):
            loading.load_campaign(variant.campaign, variant.overrides)


def test_a_study_without_campaigns_is_compared_and_written_and_kept(tmp_path):
    assert findings.reproduce(STUDY, tmp_path) is FOUND
    folder = tmp_path / "fake"
    record = json.loads((folder / "findings.json").read_text())
    assert record["provenance"]["campaigns"] == [] and record["lines"][4]["predicted"] is None
    assert record["tables"][0]["rows"][1] == ["b", None]
    assert "<table" in (folder / "findings.html").read_text()
    findings.keep(folder, tmp_path / "kept")
    page = (tmp_path / "kept/findings.md").read_text()
    assert (tmp_path / "kept/findings.json").read_bytes() == (folder / "findings.json").read_bytes()
    assert r"| peak \| first, mm | 2.1 (2 to 2.2) | 1.5 (1.25 to 1.75); 9 |  |  |  |" in page
    assert "| A6: mean, mm | 0.8 | 0.506; 12,345 runs | 0.7 to 2.5 | NO | it is colder |" in page
    assert "| A4: stops | – | 3; 9 runs | at least 1 | yes |  |" in page


@pytest.mark.slow
def test_campaigns_run_once_and_their_findings_come_out_the_same(tmp_path):
    told = []
    assert findings.reproduce(TWO, tmp_path, "simd", told.append).lines[0].predicted.value == 4
    runs = tmp_path / "fake" / "runs"
    assert told[-1].phase == "compare" and told[-1].done == told[-1].total == 4
    shares = [status.progress for status in told]
    assert shares == sorted(shares) and shares[-1] == 1.0
    first = (tmp_path / "fake" / "findings.json").read_bytes()
    made = json.loads(first)["provenance"]
    assert [c["variant"] for c in made["campaigns"]] == ["base", "faster"]
    assert len({c["config_hash"] for c in made["campaigns"]}) == 2
    parts = {path: path.stat().st_mtime_ns for path in runs.rglob("*.parquet")}
    findings.reproduce(TWO, tmp_path, "simd")
    assert {path: path.stat().st_mtime_ns for path in runs.rglob("*.parquet")} == parts
    assert (tmp_path / "fake" / "findings.json").read_bytes() == first


def test_a_target_is_met_where_every_line_with_a_band_is_inside_it():
    assert [*standings(plain(FOUND)["lines"]).values()] == [
        "A6 not met: 1 of 2 lines inside their band",
        "A4 met: 1 of 1 line inside its band",
        "A5 not judged: no line with a band has a prediction",
    ]
    (bare,) = standings([{"target": "A7", "band": None, "passed": None}]).values()
    assert bare == "A7 not judged: no line has a band"


@pytest.mark.parametrize(
    ("quotation", "words"),
    [
        (Quotation(line="mean"), "0.506 mm"),
        (Quotation(target="A6"), "A6 not met: 1 of 2 lines inside their band"),
        (Quotation(inside="*"), "2 of 3"),
        (Quotation(table="Sett*", row=("a",), column="mm"), "1.25"),
        (Quotation(line="not measured"), claims.NOT_PREDICTED),
        (Quotation(line="no such line"), claims.ABSENT),
        (Quotation(table="Settings", row=("d",), column="mm"), claims.ABSENT),
    ],
)
def test_a_number_of_a_claim_is_read_from_the_findings(quotation, words):
    assert claims.quoted(quotation, plain(FOUND)).text == words


@pytest.mark.parametrize("name", studies.NAMES)
def test_kept_findings_are_a_page_and_hold_every_number_and_table_of_their_claims(name):
    record = findings.read(REFERENCE / name)
    page = (REFERENCE / name / "findings.md").read_text(encoding="utf-8")
    assert page == findings.page(record, with_claims=False)
    section = claims.section(record)
    assert section and claims.ABSENT not in section
    titles = [table["title"] for table in record["tables"]]
    for pattern in (
        p for c in claims.read_claims(name).claim for e in c.evidence for p in e.tables
    ):
        assert any(claims.fits(pattern, title) for title in titles), pattern


def test_the_kept_pages_over_all_studies_are_those_of_the_kept_findings(tmp_path):
    records = findings.records(REFERENCE)
    kept = (REFERENCE / "credibility.md").read_text(encoding="utf-8")
    assert kept == claims.page(records) and claims.ABSENT not in kept
    out = tmp_path / "page.md"
    assert main(["credibility", str(REFERENCE), "--out", str(out)]) == 0
    assert out.read_text(encoding="utf-8") == kept
    written = (ROOT / "docs/explanation/credibility.md").read_text(encoding="utf-8")
    assert written == claims.page(records, "docs/explanation")
