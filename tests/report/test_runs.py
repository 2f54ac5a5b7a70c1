"""What sections ask of a table: counts of all rows, rows of a few, the same each time, in little
memory.
"""

import re

import pandas as pd
import pytest
import reacting_results as reacting
import synthetic_results as synthetic

from ravenjax.report import page
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import answers, detectors
from ravenjax.report.sections import reaction as pairs
from ravenjax.store import schema
from ravenjax.store.folder import ResultFolder

FRAME = synthetic.frame(3000)
MANIFEST = synthetic.manifest(3000)
RUNS = Runs.of(FRAME, MANIFEST)
FACTS = RUNS.table.frame("SELECT * FROM facts ORDER BY row")


def test_facts_of_a_folder_are_those_of_its_table(tmp_path):
    folder = ResultFolder.open(tmp_path, MANIFEST)
    for rows in folder.missing(700):
        folder.add(FRAME.iloc[rows.start : rows.stop])
    runs = Runs.open(tmp_path, MANIFEST)
    stored = schema.conform_table(
        FRAME, MANIFEST.shape
    ).to_pandas()  # in the precision of the table
    told = Runs.of(stored, MANIFEST).table.frame("SELECT * FROM facts ORDER BY row")
    found = runs.table.frame("SELECT * FROM facts ORDER BY row")
    runs.close()
    for name in told:
        one, other = (part[name].astype(str).fillna("none") for part in (found, told))
        assert (one == other).all(), name
    assert list(tmp_path.glob(".query*")) == []


def test_drawn_rows_are_the_same_each_time_about_as_many_as_asked_and_fair():
    one, other = (RUNS.drawn("results.run_id, facts.unintended", "true", 1000) for _ in range(2))
    pd.testing.assert_frame_equal(one, other)
    assert 850 < len(one) < 1150 and one["run_id"].is_unique
    assert one["unintended"].mean() == pytest.approx(FACTS["unintended"].mean(), abs=0.05)
    assert len(RUNS.drawn("row", "true", 3000)) == 3000
    moved = RUNS.drawn("results.run_id", "unintended", 10**9)
    assert moved["run_id"].tolist() == FRAME.loc[FACTS["unintended"], "run_id"].tolist()


def test_distinct_faults_however_often_they_were_run():
    twice = pd.concat([FRAME, FRAME.assign(seed=8, pair=FRAME["pair"] + 3000)], ignore_index=True)
    again = Runs.of(twice, MANIFEST)
    for kind in ("", "group", "site", "layer"):
        assert str(answers.class_rows(RUNS, kind)) == str(answers.class_rows(again, kind))
    assert again.count("sample") == RUNS.count("sample") == (FRAME["failed"] == "").sum()


def test_a_fault_that_never_acted_is_in_no_rate_and_windows_beyond_the_end_are_equal():
    idle, valid = FRAME.copy(), FRAME["failed"] == ""
    idle.loc[idle["fault0_site"] != "", "activated"] = False
    free = valid & (idle["fault0_site"] == "")
    assert Runs.of(idle, MANIFEST).count("sample") == free.sum()
    late = FRAME[valid & ~free].head(1).assign(fault0_start_ms=MANIFEST.duration_ms - 500)
    four = pd.concat(
        [late.assign(fault0_duration_ms=ms, pair=k) for k, ms in enumerate((499, 500, 700, -1))]
    )
    assert Runs.of(four, MANIFEST).count("sample") == 2


@pytest.mark.slow
def test_a_page_of_a_sample_says_so_and_counts_all(tmp_path, monkeypatch):
    frame = reacting.frame(1500)
    manifest = reacting.manifest(len(frame))
    whole = words(page.render_report(Runs.of(frame, manifest), manifest, tmp_path))
    assert "drawn by a fixed rule" not in whole
    monkeypatch.setattr(pairs, "MOST", 900)
    monkeypatch.setattr(detectors, "MOST_DRAWN", 400)
    some = words(page.render_report(Runs.of(frame, manifest), manifest, tmp_path))
    assert len(re.findall(r"Only about [\d,]+ of [\d,]+ runs, drawn by a fixed rule", some)) == 2
    counts = re.findall(r"Of [\d,]+ distinct faults.*?\)", whole) + re.findall(
        r"[\d,]+ faults with an unint[^.;]*", whole
    )
    assert len(counts) >= 4
    for sentence in counts:
        assert sentence in some


def words(html):
    return re.sub(r"<[^>]*>|\s+", " ", html[html.index("<body>") :]).replace("  ", " ")


@pytest.mark.slow
def test_a_report_needs_no_more_memory_than_it_is_given(tmp_path, monkeypatch):
    folder = ResultFolder.open(tmp_path, MANIFEST)
    folder.add(FRAME)
    monkeypatch.setenv("RAVENJAX_QUERY_MB", "64")
    assert page.build_report(tmp_path).read_text(encoding="utf-8").rstrip().endswith("</html>")
