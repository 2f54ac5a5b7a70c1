"""The report: its numbers against an independent count, one file, no request, well formed."""

import dataclasses
import itertools
import re

import naive_facts
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import synthetic_results as synthetic
from rendered_page import Page, rendered, words

from ravenjax.campaign.stop import decisions
from ravenjax.errors import StoreError
from ravenjax.outcomes.events import Rules, name_harm
from ravenjax.report import page, wording
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import wilson_interval
from ravenjax.stats.sequential import Look
from ravenjax.store import schema
from ravenjax.store.folder import ResultFolder

RUNS = 2000
FRAME = synthetic.frame(RUNS)
FACTS = naive_facts.derive(FRAME)
FAULTY = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
UNTOLD = FAULTY["response"].isin(["silent", "limited"])
EVADING = FAULTY[UNTOLD & (FAULTY["unintended_first_ms"] >= 0)]
MANIFEST = synthetic.manifest(RUNS)
TABLE = Runs.of(FRAME, MANIFEST)


def of_facts(**columns):
    """Runs of which nothing but these facts is known."""
    runs = len(next(values for values in columns.values() if np.ndim(values)))
    told = Runs.of(synthetic.frame(runs), synthetic.manifest(runs))
    told.table.run("DROP TABLE facts")
    told.table.register("facts", pa.table(pd.DataFrame(columns, range(runs)).to_dict("list")))
    told.facts = list(columns)
    return told


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("with space") / "quick"
    path = page.build_report(synthetic.folder(folder, FRAME, MANIFEST))
    return path, path.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("counts", ["replaces", "joins"])
def test_harms_of_a_campaign_are_named(tmp_path, counts):
    own = [{"name": "quick_dip", "when": "depth > 2", "counts": counts}]
    record = synthetic.manifest(300, config=MANIFEST.config | {"harm": own})
    path = page.build_report(synthetic.folder(tmp_path / "own", FRAME[:300], record))
    said = words(Page(path.read_text(encoding="utf-8")))
    assert "harm quick_dip" in said and "quick_dip: depth > 2" in said
    assert ("nintended motion" in said) == (counts == "joins")
    assert "Coverage of checks" in said


def test_one_self_contained_file(built):
    path, text = built
    parsed = Page(text)
    assert path.name == "report.html" and path.stat().st_size < 900_000
    assert parsed.fetched == ["data:,"] and parsed.stack == []
    assert '<meta charset="utf-8">' in text
    style = re.search(r"<style>(.*?)</style>", text, re.S)
    assert style and "url(" not in style[1] and "@import" not in style[1]
    assert {target.removeprefix("#") for target in parsed.targets} <= set(parsed.ids)
    assert len(set(parsed.ids)) == len(parsed.ids)


def test_headline_counts_distinct_faults(built):
    evaded = len(EVADING)
    text = words(Page(built[1]))
    assert f"Of {len(FAULTY):,} distinct faults" in text
    assert f"of this design, {evaded:,} made the live robot move" in text
    # Groups differ, so no interval covers all of them.
    assert "of faults drawn so" not in text


def test_faults_that_the_end_of_the_run_cuts_short_are_counted():
    frame = FRAME.assign(fault0_duration_ms=np.where(np.arange(RUNS) % 2, -1, 3000))
    faulty = (frame["fault0_site"] != "") & (frame["failed"] == "") & frame["activated"]
    untold = frame["response"].isin(["silent", "limited"]) & (frame["hazard"] == "none")
    cut = faulty & untold & (frame["fault0_duration_ms"] > 0) & (frame["fault0_start_ms"] > 0)
    assert tables.headline_counts(Runs.of(frame, MANIFEST), MANIFEST)["cut_short"] == cut.sum() > 0


def test_windows_on_the_clock_of_the_pedal_that_never_close_are_one_fault():
    rows = FRAME.loc[[FAULTY.index[0]] * 4].reset_index(drop=True)
    rows = rows.assign(pair=range(4), pedal_down_ms=1500, halted_ms=300, fault0_start_ms=1000)
    rows = rows.assign(fault0_trigger="pedal", fault0_duration_ms=[799, 800, 900, -1])
    distinct = Runs.of(rows, MANIFEST).table.rows('SELECT "distinct" FROM facts ORDER BY row')
    assert distinct == [(0,), (1,), (1,), (1,)]


def test_a_harm_of_ones_own_is_named_but_the_words_of_the_user_stay():
    rules = Rules(harms=("fast: speed > 20",), limit_counts=False)
    text = "<i>no unintended motion</i> An unintended motion over 3 mm"
    named = name_harm(text, rules, ["no unintended motion"])
    assert named == "<i>no unintended motion</i> harm fast"


def test_enumerated_faults_have_shares_without_intervals():
    """The same runs, of a campaign whose groups are grids: no interval in the headline, the
    classes and the matrix.
    """
    groups = [
        {"name": name, "design": "grid", "fault": [{"value": [1, 2]}]}
        for name in FRAME["group"].unique()
    ]
    manifest = synthetic.manifest(RUNS, config={**MANIFEST.config, "group": groups})
    runs = Runs.of(FRAME, manifest)
    assert not runs.sampled() and TABLE.sampled()
    head = tables.headline_counts(runs, manifest)
    assert (head["evaded"].k, head["evaded"].n) == (len(EVADING), len(FAULTY))
    assert np.isnan(head["evaded"].low)
    cells = [cell["share"] for row in tables.verdict_matrix(runs) for cell in row["cells"]]
    assert all(np.isnan(rate.low) for rate in cells) and wording.format_interval(cells[0]) == ""
    some = [{**group, "design": "lhs"} for group in groups[:1]] + groups[1:]
    mixed = Runs.of(FRAME, synthetic.manifest(RUNS, config={**MANIFEST.config, "group": some}))
    rows = {row["name"]: row["evaded"] for row in tables.group_rows(mixed) if row["faulty"]}
    assert {name for name, rate in rows.items() if not np.isnan(rate.low)} <= {groups[0]["name"]}


@pytest.mark.slow
def test_unfinished_campaign_says_so(tmp_path):
    results = ResultFolder.open(tmp_path, MANIFEST)
    results.add(FRAME.iloc[:100])
    text = page.build_report(tmp_path).read_text(encoding="utf-8")
    assert "Unfinished: 100 of 2,000 runs" in words(Page(text))


@pytest.mark.slow
@pytest.mark.parametrize("even", [True, False])
def test_a_campaign_that_stopped_by_itself_says_why_and_what_its_pooled_rates_are(tmp_path, even):
    results = ResultFolder.open(tmp_path, MANIFEST)
    results.add(FRAME.iloc[:100])
    rows = {"taken": {"dac": 60}, "held": {"dac": 800}, "intervals": (), "waiting": ()}
    known = {"widest": 0.04, "half_width": 0.05, "each": 0.99, "even": even}
    look = Look(number=2, looks=4, stop=True, **rows, **known)
    decisions.write_looks(tmp_path, [look])
    text = words(Page(page.build_report(tmp_path).read_text(encoding="utf-8")))
    assert "Stopped at look 2 of 4: every rate is known within +-0.05." in text
    pooled = "Different shares of the groups were computed: a rate over several groups needs"
    assert (pooled in text) is not even


def test_folder_without_results(tmp_path):
    with pytest.raises(StoreError, match=r"manifest.json"):
        page.build_report(tmp_path)


def edge(name):
    frame = synthetic.frame(300)
    if name == "no fault":
        return frame[frame["group"] == "fault_free"].reset_index(drop=True)
    if name == "one row":
        return frame.head(1)
    if name == "all failed":
        frame["failed"] = "nan"
    elif name == "none evades":
        frame["response"], frame["response_ms"], frame["told_ms"] = "stopped", 2900, 2900
    elif name == "nothing happens":
        frame = frame.assign(response="silent", response_ms=-1, told_ms=-1, activated=False)
        frame[[c for c in frame if c.endswith("first_ms") and not c.startswith("applied")]] = -1
        frame["halted_ms"] = 4
    return synthetic.judged(frame)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("no fault", "injected no fault"),
        ("one row", "Of 1 distinct fault of this design"),
        ("all failed", "No run with a fault gave a valid outcome."),
        ("none evades", "none made the live robot move more than 3 mm off its course"),
        ("nothing happens", "No fault changed a single bit of a run with a valid outcome."),
    ],
)
def test_edge_cases_have_a_page(name, told):
    frame = edge(name)
    html = rendered(frame, synthetic.manifest(len(frame)))
    parsed = Page(html)
    assert told in words(parsed)
    assert not re.search(r"\bnan\b.?(%|mm|ms)", words(parsed), re.I)
    assert not any("nan" in style for style in parsed.styles)


@pytest.mark.slow
def test_names_are_escaped():
    frame = synthetic.frame(60)
    frame["group"] = "<script>alert(1)</script>"
    html = rendered(frame, synthetic.manifest(60, campaign="a & <b>"))
    assert "<script>alert" not in html and "a &amp; &lt;b&gt;" in html


def test_verdict_matrix_against_a_plain_count():
    matrix = tables.verdict_matrix(TABLE)
    facts = FACTS.loc[FAULTY.index]
    assert [row["name"] for row in matrix] == ["stopped", "flagged", "limited", "silent"]
    for row in matrix:
        hazards = ["unintended motion", "loss of motion", "false report", "none"]
        for cell, (hazard, cued) in zip(
            row["cells"], itertools.product(hazards, [True, False]), strict=True
        ):
            parts = facts[["response", "hazard", "cued"]]
            mine = (parts == [row["name"], hazard, cued]).all(axis=1)
            assert cell["share"] == wilson_interval(int(mine.sum()), len(FAULTY))
            assert cell["evades"] == (
                row["name"] in ("limited", "silent") and hazard == "unintended motion"
            )
    assert sum(row["total"].k for row in matrix) == len(FAULTY)


def test_delays_are_censored_at_stop_and_end():
    runs = of_facts(
        activated=True,
        failed=False,
        faulty=True,
        sample=True,
        active_ms=[100, 100, 100, 100, 100],
        warned_ms=[150, -1, -1, 50, -1],
        response_ms=[-1, -1, 400, -1, 300],
        response=["silent", "silent", "stopped", "silent", "flagged"],
    )
    delays, early = tables.event_delays(runs, "warned_ms")
    assert delays.time.tolist() == [50, 300, 2900]
    assert delays.occurred.tolist() == [True, False, False]
    # flagged: the robot went on, so to the end
    assert delays.count.tolist() == [1, 1, 2] and early == 1


def test_every_table_is_named_and_every_heading_has_its_scope(built):
    text = re.sub(r"<script.*?</script>", "", built[1], flags=re.DOTALL)
    found = re.findall(r"<table.*?</table>", text, re.DOTALL)
    assert len(found) > 20
    for table in found:
        caption = re.search(r"^<table[^>]*>\s*<caption[^>]*>([^<]+)</caption>", table)
        assert caption and caption[1].strip(), table[:200]
        assert all("scope=" in head for head in re.findall(r"<th\b[^>]*>", table))


def test_every_chart_can_be_read_without_seeing_it(built):
    parsed = Page(built[1])
    drawings = re.findall(r'<svg class="(?:wide|narrow)"[^>]*>', built[1])
    assert len(drawings) >= 6
    for one in drawings:
        assert 'role="img"' in one and len(re.search('aria-label="([^"]*)"', one)[1]) > 40
        assert re.search('aria-describedby="([^"]*)"', one)[1] in parsed.ids


def test_a_campaign_without_fault_slots_has_a_page():
    form = dataclasses.replace(synthetic.shape(), slots=0)
    frame = synthetic.frame(80).assign(group="fault_free")[
        [column.name for column in schema.table_columns(form)]
    ]
    html = rendered(frame, synthetic.manifest(80, shape=form))
    assert "This campaign injected no fault." in words(Page(html))
