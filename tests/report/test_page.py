"""The report: its numbers against an independent count, one file, no request, well formed; rates in words."""

from __future__ import annotations

import dataclasses
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import reacting_results as reacting
import synthetic_results as synthetic

from ravenjax.campaign import decisions
from ravenjax.report import facts as run_facts
from ravenjax.report import figures, maps, page, tables, wording
from ravenjax.report.runs import Runs
from ravenjax.report.style import round_step
from ravenjax.stats.intervals import wilson
from ravenjax.stats.sequential import Look
from ravenjax.store import schema
from ravenjax.store.files import StoreError
from ravenjax.store.folder import ResultFolder

RUNS = 2000
FRAME = synthetic.frame(RUNS)
FACTS = run_facts.derive(FRAME)
FAULTY = FRAME[FRAME["fault0_site"] != ""]
MANIFEST = synthetic.manifest(RUNS)
TABLE = Runs.of(FRAME, MANIFEST)


def rendered(frame, manifest):
    return page.render(Runs.of(frame, manifest), manifest, Path("out"))


def of_facts(**columns):
    """Runs of which nothing but these facts is known."""
    runs = len(next(values for values in columns.values() if np.ndim(values)))
    told = Runs.of(synthetic.frame(runs), synthetic.manifest(runs))
    told.table.run("DROP TABLE facts")
    told.table.register("facts", pa.table(pd.DataFrame(columns, range(runs)).to_dict("list")))
    told.facts = list(columns)
    return told


class Page(HTMLParser):
    """Collects what the page would fetch, its ids and links, and whether its tags are balanced."""

    VOID = frozenset({"meta", "link", "br", "img", "input", "hr", "col"})

    def __init__(self, text):
        super().__init__()
        self.fetched, self.ids, self.targets, self.stack, self.words, self.styles = [], [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.fetched += [given[name] for name in ("src", "srcset", "data", "poster", "action") if name in given]
        self.fetched += [given["href"]] if tag in ("link", "base") else []
        self.targets += [given["href"]] if tag == "a" else []
        self.ids += [given["id"]] if "id" in given else []
        self.styles += [given["style"]] if "style" in given else []
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if not {"script", "style"} & set(self.stack):
            self.words.append(data)


def words(page):
    return re.sub("[ \n]+", " ", " ".join(page.words))


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("with space") / "quick"
    results = ResultFolder.open(folder, MANIFEST)
    for rows in results.missing(300):
        results.add(FRAME.iloc[rows.start : rows.stop])
    results.close(compile_s=12.0, run_s=40.0, rows=RUNS)
    path = page.build(folder)
    return path, path.read_text(encoding="utf-8")


# --- the page ---------------------------------------------------------------------------------------------------------


def test_one_self_contained_file(built):
    path, text = built
    parsed = Page(text)
    assert path.name == "report.html" and path.stat().st_size < 8_000_000
    assert parsed.fetched == ["data:,"] and parsed.stack == []
    assert text.count("plotly.js v") == 1 and '<meta charset="utf-8">' in text
    style = re.search(r"<style>(.*?)</style>", text, re.S)
    assert style and "url(" not in style[1] and "@import" not in style[1]
    assert {target.removeprefix("#") for target in parsed.targets} <= set(parsed.ids)
    assert len(set(parsed.ids)) == len(parsed.ids)


def test_headline_counts_distinct_faults(built):
    evaded = FAULTY["verdict"].astype(str).str.startswith("silent/haptic").sum()
    rate = wilson(evaded, len(FAULTY))
    text = words(Page(built[1]))
    assert f"Of {len(FAULTY):,} distinct faults" in text
    assert f"{evaded:,} ({100 * rate.value:.1f}\u202f%)" in text
    assert f"(95\xa0% interval {100 * rate.low:.1f}–{100 * rate.high:.1f}\u202f%)" in text


def test_each_worst_run_has_its_replay_command(built):
    path, text = built
    silent = FAULTY[(FAULTY["response"] == "none") & (FAULTY["failed"] == "")]
    worst = silent.nlargest(tables.WORST, "peak_model_deviation_mm")["run_id"]
    for run_id in worst:
        assert f"ravenjax trace '{path.parent}' {run_id}".replace("'", "&#39;") in text


def test_provenance(built):
    text = words(Page(built[1]))
    for value in (MANIFEST.config_hash, MANIFEST.code_hash, MANIFEST.device, "seed", "50 runs/s", "jax", "suturing"):
        assert value in text


def test_unfinished_campaign_says_so(tmp_path):
    results = ResultFolder.open(tmp_path, MANIFEST)
    results.add(FRAME.iloc[:100])
    assert "Unfinished: 100 of 2,000 runs" in words(Page(page.build(tmp_path).read_text(encoding="utf-8")))


@pytest.mark.parametrize("even", [True, False])
def test_a_campaign_that_stopped_by_itself_says_why_and_what_its_pooled_rates_are(tmp_path, even):
    results = ResultFolder.open(tmp_path, MANIFEST)
    results.add(FRAME.iloc[:100])
    look = Look(2, 4, {"dac": 60}, {"dac": 800}, (), 0.04, (), True, half_width=0.05, each=0.99, even=even)
    decisions.write(tmp_path, [look])
    text = words(Page(page.build(tmp_path).read_text(encoding="utf-8")))
    assert "Stopped at look 2 of 4: every rate is known within +-0.05." in text
    assert ("Groups were computed to different shares: weigh them for a rate over several." in text) is not even


def test_folder_without_results(tmp_path):
    with pytest.raises(StoreError, match=r"manifest.json"):
        page.build(tmp_path)


def edge(name):
    frame = synthetic.frame(300)
    if name == "no fault":
        return frame[frame["group"] == "fault_free"].reset_index(drop=True)
    if name == "one row":
        return frame.head(1)
    if name == "all failed":
        frame["failed"] = "nan"
    elif name == "none evades":
        frame["response"], frame["response_ms"] = "stopped", 2900
    elif name == "nothing happens":
        frame["response"], frame["response_ms"], frame["activated"] = "none", -1, False
        frame[[c for c in frame if c.startswith("cue") and c.endswith("first_ms")]] = -1
    elif name == "one fault repeated":
        given = [c for c in frame if c.startswith(("fault", "param:")) or c == "operator"]
        frame[given] = frame.loc[[0] * len(frame), given].to_numpy()
    frame["verdict"] = schema.verdict(frame)
    return frame


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("no fault", "injected no fault"),
        ("one row", "Of 1 distinct fault,"),
        ("all failed", "none slipped past every built-in check"),
        ("none evades", "none slipped past every built-in check"),
        ("nothing happens", "No run had both a cue and a built-in response"),
        ("one fault repeated", "Of 1 distinct fault,"),
    ],
)
def test_edge_cases_have_a_page(name, told):
    frame = edge(name)
    html = rendered(frame, synthetic.manifest(len(frame)))
    parsed = Page(html)
    assert told in words(parsed)
    assert not re.search(r"\bnan\b.?(%|mm|ms)", words(parsed), re.I)
    assert not any("nan" in style for style in parsed.styles)


def test_names_are_escaped():
    frame = synthetic.frame(60)
    frame["group"] = "<script>alert(1)</script>"
    html = rendered(frame, synthetic.manifest(60, campaign="a & <b>"))
    assert "<script>alert" not in html and "a &amp; &lt;b&gt;" in html


def test_verdicts_may_use_another_cue():
    frame = FRAME.assign(verdict=schema.verdict(FRAME, 6, "jump_text"))
    text = words(Page(rendered(frame, synthetic.manifest(RUNS, verdict_cue=6, verdict_jump="jump_text"))))
    good = FAULTY[(FAULTY["failed"] == "") & (FAULTY["response"] == "none")]
    assert f"{(good['cue6_first_ms'] >= 0).sum()} (" in text
    assert "more than 5 mm away from its nominal model" in text and "tip motion > 1 mm within 2 ms" in text


# --- the numbers ------------------------------------------------------------------------------------------------------


def test_verdict_matrix_against_a_plain_count():
    matrix = tables.verdict_matrix(TABLE)
    counts = FAULTY["verdict"].astype(str).value_counts()
    for row in matrix:
        for cell, tail in zip(
            row["cells"], ["haptic/jump", "haptic/no jump", "no haptic/jump", "no haptic/no jump"], strict=True
        ):
            assert cell["rate"] == wilson(counts.get(f"{row['name']}/{tail}", 0), len(FAULTY))
    assert sum(row["total"].k for row in matrix) + counts[""] == len(FAULTY)


def test_every_run_has_one_outcome_and_failures_are_kept():
    assert set(FACTS["outcome"]) <= set(run_facts.OUTCOMES)
    assert (FACTS["outcome"] == "failed").sum() == (FRAME["failed"] != "").sum() > 0
    rows = tables.group_rows(TABLE)
    assert sum(row["n"] for row in rows) == RUNS
    assert all(sum(rate.k for rate in row["outcomes"].values()) == row["n"] for row in rows)
    assert sum(row["n"] for row in tables.failure_rows(TABLE, Path("x"))) == (FRAME["failed"] != "").sum()


def test_repeats_count_once():
    twice = pd.concat([FRAME, FRAME.assign(seed=8)], ignore_index=True)
    once, again = tables.headline(TABLE), tables.headline(Runs.of(twice, MANIFEST))
    assert again["evaded"] == once["evaded"] and again["repeated"] and not once["repeated"]
    assert again["runs"] == 2 * once["runs"]


def test_delays_are_censored_at_stop_and_end():
    runs = of_facts(
        activated=True,
        failed=False,
        faulty=True,
        active_ms=[100, 100, 100, 100],
        cue_ms=[150, -1, -1, 50],
        response_ms=[-1, -1, 400, -1],
        response=["silent", "silent", "stopped", "silent"],
    )
    delays, early = tables.delays(runs, "cue_ms", 3000)
    assert delays.time.tolist() == [50, 300, 2900] and delays.came.tolist() == [True, False, False]
    assert delays.count.tolist() == [1, 1, 1] and early == 1


@pytest.mark.parametrize("values", [np.arange(200, 2400), np.linspace(-3, 3, 500), 2.0 ** np.linspace(0, 9, 300)])
def test_bins_hold_their_values(values):
    axis = maps.bins(values)
    number, labels = axis.number(values), axis.labels
    limits = [[float(edge.replace("−", "-").replace("k", "e3")) for edge in label.split(" to ")] for label in labels]
    assert number.min() == 0 and number.max() == len(labels) - 1 <= 12
    for value, i in zip(values, number, strict=True):
        assert limits[i][0] <= value < limits[i][1]


def test_few_values_have_a_bin_each():
    values = np.array([8.0, 1, 64, 8])
    axis = maps.bins(values)
    assert axis.labels == ["1", "8", "64"] and axis.number(values).tolist() == [1, 0, 2, 1]


def test_maps_count_each_valid_faulty_run_once():
    valid = FAULTY[FAULTY["failed"] == ""]
    made = maps.evasion_maps(TABLE)
    assert sum(item["n"] for item in made) == len(valid)
    assert sum(item["evaded"].k for item in made) == valid["verdict"].astype(str).str.startswith("silent/haptic").sum()
    for item in made:
        for panel in item["panels"]:
            cells = [cell for row in panel["rows"] for cell in row["cells"] if cell is not None]
            assert (sum(c.k for c in cells), sum(c.n for c in cells)) == (item["evaded"].k, item["n"])
            assert all(len(row["cells"]) == len(panel["columns"]) for row in panel["rows"])


def a_map(**columns):
    """The one map of faults with these inputs; every second one evades."""
    runs = len(next(iter(columns.values())))
    same = {"faulty": True, "failed": False, "plain": True, "block": "a · b", "onset_ms": 5, "length_ms": 7}
    given = same | {"magnitude": 1.0, "evaded": np.arange(runs) % 2 == 1} | columns
    (made,) = maps.evasion_maps(of_facts(**given))
    return made


def test_a_duration_until_the_end_is_said_so_and_comes_last():
    lengths = np.tile([-1, -1, 30, 30, 300, 300], 4)
    (panel,) = a_map(length_ms=lengths, onset_ms=np.repeat([100, 200], 12))["panels"]
    assert (panel["across"], panel["up"]) == ("onset, ms", "duration, ms")
    assert [row["label"] for row in panel["rows"]] == ["to the end", "300", "30"]
    assert {cell for row in panel["rows"] for cell in row["cells"]} == {wilson(2, 4)}


def test_durations_that_are_binned_leave_those_until_the_end_alone():
    lengths = np.concatenate([np.arange(1, 200), np.full(57, -1)])
    made = a_map(length_ms=lengths, magnitude=np.tile([1.0, 2.0, 3.0, 4.0], 64))
    (panel,) = made["panels"]
    assert panel["columns"][-1] == "to the end" and "-1" not in "".join(panel["columns"]).replace("−", "-")
    last = [row["cells"][-1].n for row in panel["rows"]]
    assert sum(last) == 57


def test_a_bin_without_runs_is_no_rate():
    onset = np.repeat([100, 200], 12)
    (panel,) = a_map(onset_ms=onset, length_ms=np.where(onset == 100, 1, 2))["panels"]
    assert [[cell and cell.n for cell in row["cells"]] for row in panel["rows"]] == [[None, 12], [12, None]]


# outcome: (response, cue fires, tip jumps, largest true distance from the model in mm, failed)
CASES = {
    "stopped": ("stopped", True, True, 9.0, ""),
    "flagged": ("flagged", True, False, 9.0, ""),
    "felt": ("none", True, True, 3.1, ""),
    "unseen": ("none", False, True, 3.1, ""),
    "phantom": ("none", True, True, 2.9, ""),
    "jumped": ("none", False, True, 2.9, ""),
    "quiet": ("none", False, False, 2.9, ""),
    "failed": ("none", True, True, 9.0, "nan"),
}


def test_each_outcome_is_what_it_says():
    frame = synthetic.frame(400)
    frame = frame[frame["fault0_site"] != ""].head(len(CASES)).reset_index(drop=True)
    response, cue, jump, distance, failed = zip(*CASES.values(), strict=True)
    frame["response"], frame["failed"], frame["peak_model_deviation_mm"] = response, failed, distance
    frame["cue0_first_ms"], frame["jump_code"] = np.where(cue, 500, -1), jump
    frame["verdict"] = schema.verdict(frame)
    facts = run_facts.derive(frame, threshold_mm=3.0)
    assert facts["outcome"].tolist() == list(CASES) == list(run_facts.OUTCOMES)
    assert facts.loc[facts["evaded"], "outcome"].tolist() == ["felt", "unseen"]
    runs = Runs.of(frame, synthetic.manifest(len(frame)))
    head = tables.headline(runs)
    assert head["evaded"] == wilson(2, 8) and (head["felt"], head["unseen"], head["phantom"]) == (1, 1, 1)
    again = Runs.of(frame.assign(group="g"), synthetic.manifest(len(frame)))
    assert tables.group_rows(again)[0]["evaded"] == wilson(2, 8)


def leads(cue_ms, response_ms):
    figure = figures.lead_histogram(of_facts(faulty=True, failed=False, cue_ms=cue_ms, response_ms=response_ms))
    return {trace["name"].partition(" (")[0]: sum(trace["y"]) for trace in json.loads(figure)["data"]}


def test_a_tie_is_neither_first():
    response = [100, 150, 90, 100, 300, 100, 100]
    assert leads(100, response) == {"response first": 1, "cue first": 2, "same millisecond": 4}
    assert leads([5, 5], [5, 5]) == {"response first": 0, "cue first": 0, "same millisecond": 2}
    runs = Runs.of(FRAME.assign(cue0_first_ms=100, response_ms=100), MANIFEST)
    head = tables.headline(runs)
    assert head["same_ms"] == head["cue_first"].n > 0 == head["cue_first"].k


def test_figures_fit_plotlys_schema():
    import plotly.graph_objects as go

    curves, _ = figures.incidence_curves(TABLE, MANIFEST)
    for text in (curves, figures.lead_histogram(TABLE)):
        figure = go.Figure(json.loads(text))
        assert figure.data and figure.layout.height == figures.HEIGHT


def test_sites_where_nothing_evaded_are_named_with_their_bound():
    frame = FRAME.assign(response=FRAME["response"].where(FRAME["fault0_site"] != "encoder", "stopped"))
    frame["verdict"] = schema.verdict(frame)
    text = words(Page(rendered(frame, MANIFEST)))
    runs = ((frame["fault0_site"] == "encoder") & (frame["failed"] == "")).sum()
    bound = wording.percent(wilson(0, int(runs)).high)
    assert f"No run evaded among encoder · bit_flip ({runs} runs, at most {bound})." in text


def test_groups_are_told_by_who_responded_and_what_moved(built):
    text = words(Page(built[1]))
    assert "a check responded no check responded" in text
    assert "stopped not stopped moved, cue fired moved, no cue stayed near, cue fired stayed near, jumped" in text


# --- words ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (12345.6, "12,346"),
        (-0.004567, "−0.00457"),
        (float("nan"), "–"),
        (14.0, "14"),
        (1e9, "1e+09"),
        (9e-5, "0.00009"),
        (float("inf"), "–"),
    ],
)
def test_numbers(value, text):
    assert wording.number(value) == text


def test_rates_in_words():
    assert wording.percent(0.1561) == "15.6\u202f%" and wording.percent(0.0041) == "0.41\u202f%"
    assert wording.interval(wilson(0, 170)) == "0.0–2.2\u202f%" and wording.interval(wilson(0, 0)) == "no runs"


def test_fault_in_words():
    row = FRAME.iloc[0].to_dict() | {
        "fault0_site": "usb_out", "fault0_arm": "gold", "fault0_channel": "shoulder", "fault0_effect": "overwrite",
        "fault0_value": -18000.0, "fault0_trigger": "pedal", "fault0_start_ms": 1200, "fault0_duration_ms": 300,
        "fault0_every_ms": 8000,
    }  # fmt: skip
    assert wording.fault(row) == (
        "usb_out gold shoulder, overwrite −18,000, 300 ms from 1,200 ms, every 8,000 ms (pedal)"
    )
    assert wording.fault(row | {"fault0_site": ""}) == "no fault"


def test_round_steps():
    assert [round_step(x) for x in (0.0, 0.9, 274.0, 6.1, 0.031)] == [1.0, 1.0, 250.0, 5.0, pytest.approx(0.025)]


# --- campaigns of another shape ---------------------------------------------------------------------------------------


def test_a_campaign_without_fault_slots_has_a_page():
    form = dataclasses.replace(synthetic.shape(), slots=0)
    frame = synthetic.frame(80).assign(group="fault_free")[[column.name for column in schema.columns(form)]]
    html = rendered(frame, synthetic.manifest(80, shape=form))
    assert "This campaign injected no fault." in words(Page(html))


def test_reactions_without_any_fault_still_show_their_interruptions():
    frame = reacting.frame(60)
    free = frame.assign(**{name: "" for name in frame if re.fullmatch(r"fault0_(site|effect)", name)})
    text = words(Page(rendered(free, reacting.manifest(len(free)))))
    assert "Interruptions of fault-free motion" in text and "nothing to compare" in text


def test_everybody_reacts_so_there_are_no_pairs():
    frame = reacting.frame(120)
    frame = frame[frame["param:reaction.action"] == 1].reset_index(drop=True)
    text = words(Page(rendered(frame, reacting.manifest(len(frame)))))
    assert "nothing to compare" in text and "The 3 mm cue announces" in text


def test_sections_that_have_nothing_to_say_are_left_out():
    form = dataclasses.replace(synthetic.shape(), detectors=(), parameters=())
    frame = FRAME[[column.name for column in schema.columns(form)]]
    parsed = Page(rendered(frame, synthetic.manifest(RUNS, shape=form, detectors=())))
    assert not {"detectors", "reaction", "robots", "risk"} & set(parsed.ids)
    assert {"cues", "precision", "paths", "worst"} <= set(parsed.ids)
    assert {target.removeprefix("#") for target in parsed.targets} <= set(parsed.ids)


def test_the_first_page_answers_three_questions(built):
    text = words(Page(built[1]))
    for question in ("Which faults evade?", "How long before anyone can know?", "What would the cue change?"):
        assert question in text
    known = re.search(r"Half of the ([\d,]+) faults that did harm could be known within ([\d.,]+) ms", text)
    harmful = FAULTY[(FAULTY["failed"] == "") & FAULTY["activated"]]
    assert known and int(known[1].replace(",", "")) == ((harmful["moved_first_ms"] >= 0) | harmful["jump_code"]).sum()


def test_hazards_of_the_library_have_a_risk_table():
    frame = FRAME.assign(group=FRAME["group"].where(FRAME["group"] != "encoder", "library/B24"))
    parsed = Page(rendered(frame, MANIFEST))
    assert "risk" in parsed.ids and "B24" in words(parsed)
