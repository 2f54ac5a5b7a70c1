"""Running a study: its campaigns into folders, its comparison, its files; what is there is not
computed again.
"""

from __future__ import annotations

import dataclasses
import json

import pytest
from fake_study import FINDINGS, STUDY

from ravenjax.errors import UserError
from ravenjax.store import manifest
from studies import running
from studies.framework.study import Findings, Line, StudyEstimate, Variant

SHORT = ("campaign.duration_s=0.03", "campaign.limit=2")


def counted(context):
    rows = [manifest.read(folder).done for folder in context.folders.values()]
    return Findings((Line("runs", "", None, StudyEstimate(sum(rows))),))


TWO = dataclasses.replace(
    STUDY,
    compare=counted,
    variants=(
        Variant("base", "seed_fault_free.toml", SHORT),
        Variant("faster", "seed_fault_free.toml", (*SHORT, "operator.seed=2"), "another motion"),
    ),
)


def test_a_study_without_campaigns_is_compared_and_written(tmp_path):
    assert running.run(STUDY, tmp_path) is FINDINGS
    assert (
        json.loads((tmp_path / "fake" / "findings.json").read_text())["provenance"]["campaigns"]
        == []
    )


@pytest.mark.slow
def test_campaigns_run_once_and_their_findings_come_out_the_same(tmp_path):
    told = []
    findings = running.run(TWO, tmp_path, "simd", told.append)
    assert findings.lines[0].predicted == StudyEstimate(4)
    runs = tmp_path / "fake" / "runs"
    assert sorted(path.name for path in runs.iterdir()) == ["base", "faster"]
    assert {status.phase for status in told} == {"run", "compare"} and told[-1].phase == "compare"
    assert told[-1].done == told[-1].total == 4 and told[-1].progress == 1.0
    shares = [status.progress for status in told]
    assert shares == sorted(shares)
    first = (tmp_path / "fake" / "findings.json").read_bytes()
    made = json.loads(first)["provenance"]
    assert made["engine"] == "simd" and [c["variant"] for c in made["campaigns"]] == [
        "base",
        "faster",
    ]
    assert (
        made["campaigns"][1]["question"] == "another motion" and made["campaigns"][1]["runs"] == 2
    )
    assert len({c["config_hash"] for c in made["campaigns"]}) == 2

    parts = {path: path.stat().st_mtime_ns for path in runs.rglob("*.parquet")}
    running.run(TWO, tmp_path, "simd")
    assert {path: path.stat().st_mtime_ns for path in runs.rglob("*.parquet")} == parts
    assert (tmp_path / "fake" / "findings.json").read_bytes() == first


def test_two_variants_of_one_name_are_refused_before_anything_runs(tmp_path):
    twice = dataclasses.replace(TWO, variants=(TWO.variants[0], TWO.variants[0]))
    with pytest.raises(ValueError, match="share a name"):
        running.run(twice, tmp_path)
    assert not (tmp_path / "fake").exists()


def test_an_unknown_study_is_named(tmp_path):
    with pytest.raises(UserError, match="seed_burst"):
        running.reproduce("seed_brust", tmp_path)


def test_a_bad_override_is_told_before_anything_runs(tmp_path):
    wrong = dataclasses.replace(
        TWO, variants=(Variant("base", "seed_fault_free.toml", ("campaign.sed=1",)),)
    )
    with pytest.raises(UserError, match=r"campaign\.sed"):
        running.run(wrong, tmp_path)
    assert not (tmp_path / "fake").exists()
