"""The debrief: what it says, what it leaves open, and that it opens offline."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from unittest import mock

import numpy as np
import pytest
import synthetic_session as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.cli import main
from ravenjax.errors import StoreError
from ravenjax.store.logs.session import log
from ravenjax.train.debrief import course as debrief_course
from ravenjax.train.debrief import figures as debrief_figures
from ravenjax.train.debrief import page as debrief
from ravenjax.train.debrief import words as debrief_words
from ravenjax.train.recording import hazards as hazard_table
from ravenjax.train.recording import reader

MET = synthetic.hazard(0)
MISSED = synthetic.hazard(1, struck=9000.0, cue=None, known=None, response=None, off=12.0, ok=False)
ALARMED = synthetic.hazard(2, struck=15_000.0, alarm=240.0, response=380.0, off=3.8)
UNSTRUCK = synthetic.hazard(3, struck=None)
CARRIED_ON = synthetic.hazard(
    4,
    struck=4000.0,
    response=None,
    response_ok=True,
    right_response="continue",
    outcome="avoided",
    what="continue",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = synthetic.write(
        tmp_path_factory.mktemp("debrief") / "s", [ALARMED, UNSTRUCK, MET, MISSED], seconds=20.0
    )
    debrief.write(made)
    return made


def text_of(html):
    """What a reader sees of a page, without scripts."""
    plain = re.sub(r"<(script|style)\b.*?</\1>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", plain))


@pytest.mark.slow
def test_the_table_is_read_back_as_it_was_written(folder):
    found = hazard_table.read_table(folder)
    assert found == [MET, MISSED, ALARMED, UNSTRUCK]  # in order of the strike
    assert found[2].after == {"knowable": 35.0, "cue": 90.0, "alarm": 240.0, "response": 380.0}
    assert found[3].after == {} and hazard_table.read_table(folder.parent) == []


def test_a_damaged_table_is_named(tmp_path):
    synthetic.write(tmp_path, [MET], recorded=False)
    path = tmp_path / "hazards.csv"
    whole = path.read_text()
    path.write_text(whole.replace("2430.0", "soon"))
    with pytest.raises(StoreError, match="line 2: response_ms is 'soon', expected a number"):
        hazard_table.read_table(tmp_path)
    path.write_text(whole.replace("response_ms", "answer"))
    with pytest.raises(StoreError, match="no column response_ms"):
        hazard_table.read_table(tmp_path)


def test_a_hazard_in_words():
    told = debrief_words.sentence(MET, blinded=False)
    assert (
        told
        == "It struck at 2.0 s on the gold arm. Anyone could have known after 35 ms, by the tip's"
        " motion. The cue came after 90 ms; the operator lifted the pedal after 430 ms, 395 ms"
        " after the first sign: the right response. No check did anything. No harm was done. No"
        " motion hazard while live: the true tip was up to 6.5 mm off, limit 8 mm. The tip was"
        " 1.5 mm deep in the tissue."
    )
    assert "cue" not in debrief_words.sentence(MET, blinded=True).lower()
    told = debrief_words.sentence(MISSED, blinded=False)
    assert (
        "Nothing that a person can see gave it away. No response followed (right: lift the pedal)."
        in told
    )
    assert debrief_words.sentence(UNSTRUCK, blinded=False) == "It was armed and never struck."
    told = debrief_words.sentence(CARRIED_ON, blinded=True)  # to carry on has no moment
    assert "The operator carried on, the right response." in told


HAPPENED = {
    "unintended motion": (
        {"unintended_mm": 12.34, "unintended_off_mm": 1.0},
        (
            "Unintended motion: while live, the true tip was up to 12.3 mm off, limit {limit}."
            " While not live it was up to 1.0 mm off{over}."
        ),
    ),
    "loss of motion": (
        {"loss_mm": 9.0, "loss_first_ms": 2100.0},
        "Loss of motion: the instrument did not follow and was up to 9.0 mm off, limit {limit}.",
    ),
    "halted": (
        {"motion_hazard": "loss of motion", "halted_ms": 640.0, "golden_halted_ms": 40.0},
        (
            "Loss of motion: the robot was out of pedal-down for 600 ms although the pedal was"
            " held, limit 200 ms, and no check had stopped it."
        ),
    ),
    "false report": (
        {"false_report_mm": 20.0, "unintended_mm": 0.5},
        (
            "False report: the reported tip was up to 20.0 mm off the true one, limit {limit}; the"
            " true tip itself was up to 0.5 mm off."
        ),
    ),
    "none": (
        {"unintended_mm": 1.25},
        "No motion hazard while live: the true tip was up to 1.2 mm off, limit {limit}.",
    ),
}


@pytest.mark.parametrize("limit_mm", [0.75, 3.0, 10.0])
@pytest.mark.parametrize("kind", HAPPENED)
def test_what_happened_to_the_robot_in_words(kind, limit_mm):
    columns, sentence = HAPPENED[kind]
    one = synthetic.hazard(0, **({"motion_hazard": kind} | columns), limit_mm=limit_mm)
    over = ", over that limit" if limit_mm < 1.0 else ""
    assert debrief_words.motion(one) == sentence.format(limit=f"{limit_mm:g} mm", over=over)
    assert debrief_words.motion(one) in debrief_words.sentence(one, blinded=False)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A session of which tests replace everything but the recording."""
    return synthetic.write(
        tmp_path_factory.mktemp("short"), [synthetic.hazard(0, struck=500.0)], seconds=1.2
    )


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    limit_mm=st.floats(0.1, 40.0).map(lambda x: round(x, 2)),
    threshold_mm=st.floats(0.1, 40.0).map(lambda x: round(x, 2)),
)
def test_a_page_names_the_sessions_own_limits_and_no_others(short, limit_mm, threshold_mm):
    """Limits of a few digits, read back from the text; 3 mm stands there only if it is one of
    them.
    """
    hazards = [synthetic.hazard(0, struck=500.0, limit_mm=limit_mm, motion_hazard="none")]
    header = {
        "scenario": {"name": "x", "harm": {"excursion_mm": limit_mm}},
        "cue_threshold_mm": threshold_mm,
    }
    synthetic.write(short, hazards, recorded=False, **header)
    with mock.patch("plotly.offline.get_plotlyjs", return_value=""):
        html = debrief.render(short)
    limits = {float(number) for number in re.findall(r"limit ([\d.]+) mm", text_of(html))}
    assert limits == {limit_mm}
    lines = dict(re.findall(r'"([\d.e-]+) mm, (threshold of the cue|limit of hazards)"', html))
    assert {name: float(number) for number, name in lines.items()} == {
        "threshold of the cue": threshold_mm,
        "limit of hazards": limit_mm,
    } or limit_mm == threshold_mm
    late = re.search(
        r"Harm begins at ([\d.]+) mm, not beyond the cue&#39;s threshold of ([\d.]+) mm", html
    )
    assert (late is not None) is (limit_mm <= threshold_mm)
    if late is not None:
        assert (float(late[1]), float(late[2])) == (limit_mm, threshold_mm)
    if 3.0 not in (limit_mm, threshold_mm):
        assert not re.search(r"(?<![\d.])3 mm", html)


def test_steps_stand_in_order_of_time_and_what_never_came_last():
    late = synthetic.hazard(0, cue=500.0, alarm=20.0, response=100.0)
    steps = debrief_words.steps(late, blinded=False)
    assert [one.kind for one in steps] == ["strike", "alarm", "knowable", "response", "cue"]
    steps = debrief_words.steps(synthetic.hazard(0, cue=None, response=None), blinded=False)
    assert [(one.kind, one.after_ms) for one in steps[2:]] == [
        ("cue", None),
        ("alarm", None),
        ("response", None),
    ]
    assert "cue" not in [one.kind for one in debrief_words.steps(late, blinded=True)]


def test_the_summary_counts_right_responses_only():
    wrong = synthetic.hazard(1, response=200.0, ok=False)
    numbers = debrief_words.summary([MET, MISSED, wrong, ALARMED, UNSTRUCK, CARRIED_ON])
    assert (numbers.strikes, numbers.right, numbers.timed) == (5, 3, 2)
    assert numbers.reaction_ms == np.median([395.0, 345.0]) and numbers.farthest_mm == 12.0
    assert debrief_words.headline([], debrief_words.summary([]), True) == (
        "No hazard struck",
        " in this session.",
    )


@pytest.mark.slow
def test_curves_meet_the_recording(folder):
    course = debrief_course.Course(reader.read(folder), 2.5, 8.0)
    figure = json.loads(debrief_figures.hazard(course, MET, debrief_words.steps(MET, False)).json)
    off = next(one for one in figure["data"] if one["name"] == "unintended motion of the true tip")
    assert max(off["y"]) == pytest.approx(MET.unintended_mm, rel=1e-3)
    assert off["x"][int(np.argmax(off["y"]))] == 430  # where the operator let go
    pedal = [one for one in figure["data"] if one["type"] == "bar" and one["y"][0] == "pedal"]
    up = next(one for one in pedal if one["text"][0] == "up")
    assert (up["base"], up["x"]) == ([430], [700])
    lines = [one["x0"] for one in figure["layout"]["shapes"] if one.get("yref") == "paper"]
    assert lines == [0, 35, 90, 430]
    levels = [one["y0"] for one in figure["layout"]["shapes"] if one["yref"] == "y"]
    labels = [one["text"] for one in figure["layout"]["annotations"] if one.get("xref") == "paper"]
    assert levels == [2.5, 8.0]
    assert labels == ["2.5 mm, threshold of the cue", "8 mm, limit of hazards"]
    assert debrief_figures.hazard(course, synthetic.hazard(0, struck=60_000.0), []) is None


def test_thinning_keeps_every_peak():
    time, values = np.arange(100_000.0), np.zeros(100_000)
    values[[17, 54_321, 99_998]] = 1, 2, 3
    x, y = debrief_course.peaks(time, values)
    assert (
        len(x) < 1000 and {17, 54_321, 99_998} <= set(x) and y.sum() == 6 and (np.diff(x) > 0).all()
    )


def test_pauses_are_left_out(tmp_path):
    layout = synthetic.FrameLayout.of(("gold",))
    rows = synthetic.rows(layout, [], 1.0)
    rows[400:600, layout.places["session_tick"]] = 400
    rows[600:, layout.places["session_tick"]] -= 199
    writer = log.SessionWriter(tmp_path / log.FILE, layout.names(), {})
    writer.add(0, rows)
    writer.close()
    course = debrief_course.Course(reader.read(tmp_path))
    np.testing.assert_array_equal(course.ms, np.arange(801))


def test_the_page_is_honest_about_what_is_missing(tmp_path):
    bare = synthetic.write(tmp_path / "bare", None, recorded=False, ended=None, summary={})
    told = text_of(debrief.render(bare))
    assert "Nothing is known of hazards" in told and "did not end by itself" in told
    assert "There is no recording" in told and "Nobody timed this session" in told

    cut = synthetic.write(tmp_path / "cut", [MET, ALARMED], seconds=8.0)
    data = (cut / log.FILE).read_bytes()
    (cut / log.FILE).write_bytes(data[: len(data) // 2])
    told = text_of(debrief.render(cut))
    assert "The recording was cut short" in told and "ravenjax log recover" in told
    assert "The recording does not reach this hazard" in told

    (cut / log.FILE).write_bytes(b"nothing")
    assert "cannot be read" in text_of(debrief.render(cut))
    with pytest.raises(StoreError, match="not the folder of a session"):
        debrief.write(tmp_path)


def test_hazards_of_a_killed_session_come_from_its_events(tmp_path):
    layout = synthetic.FrameLayout.of(("gold",))
    listed = {"hazard": MET.hazard, "title": MET.title, "right_response": ["release"]}
    header = {"name": MET.session, "ended": None, "arms": ["gold"]} | {
        "scenario": {"name": MET.scenario, "harm": {"excursion_mm": MET.limit_mm}},
        "hazards": [{"number": 0, **listed}],
        **{"participant": MET.participant, "group": MET.group, "seed": 7, "cue": True},
    }
    told = [
        {"tick": 1500, "kind": "hazard_armed", "number": 0},
        {"tick": 2000, "kind": "hazard_struck", "number": 0},
        {"tick": 3400, "kind": "hazard_over", "number": 0, "outcome": MET.outcome},
        {"tick": 3400, "kind": "hazard_row", "row": dataclasses.asdict(MET)},
        {"tick": 3900, "kind": "hazard_armed", "number": 0},
        {"tick": 3950, "kind": "hazard_struck", "number": 0},
    ]
    synthetic.write(tmp_path, None, recorded=False, **header)
    writer = log.SessionWriter(tmp_path / log.FILE, layout.names(), header)
    writer.add(0, synthetic.rows(layout, [MET], 4.0), told)
    writer.close()
    data = (tmp_path / log.FILE).read_bytes()
    (tmp_path / log.FILE).write_bytes(data[:-40])  # it never came to its end
    first, second = hazard_table.from_recording(reader.read(tmp_path), header)
    assert first == MET
    assert (second.armed_ms, second.struck_ms, second.outcome) == (3900, 3950, "")
    assert second.score is None and second.response_ms is None
    assert main(["log", "debrief", str(tmp_path)]) == 0
    assert main(["log", "debrief", str(tmp_path / "none")]) == 2
    page = text_of((tmp_path / debrief.FILE).read_text())
    assert "put together from what the recording tells" in page and "1 of 2 hazards met" in page
    assert "How it ended is not known" in page


def test_a_blinded_session_tells_nothing_of_cue_and_group(tmp_path):
    made = synthetic.write(tmp_path, [MET], seconds=4.0, blinded=True, group="treated")
    html = debrief.render(made)
    table = json.loads(
        json.loads(json.dumps(re.search(r'id="csv-hazards">(.*?)</script>', html, re.S)[1]))
    )
    assert "cue" not in table.splitlines()[0].split(",") and "treated" not in html
    assert (
        "the cue came" not in text_of(html).lower() and "with the cue" not in text_of(html).lower()
    )
    assert "force felt" not in html and "unintended motion of the true tip" in html


def test_text_from_a_session_cannot_become_markup(tmp_path):
    made = synthetic.write(
        tmp_path, [synthetic.hazard(0, title="<script>alert(1)</script>")], participant="<b>P</b>"
    )
    html = debrief.render(made)
    assert "<script>alert" not in html.lower() and "<b>P</b>" not in html and "&lt;b&gt;P" in html


@pytest.mark.slow
def test_the_page_opens_offline_and_fits(folder):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = (
        shutil.which("chromium")
        or shutil.which("chromium-browser")
        or shutil.which("google-chrome")
    )
    if chromium is None:
        pytest.skip("no chromium on the path (apt-get install chromium)")
    asked, told = [], []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: told.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: told.append(str(error)))
        page.goto((folder / debrief.FILE).as_uri())
        page.wait_for_function(
            "[...document.querySelectorAll('.figure')].every((one) =>"
            " one.querySelector('.main-svg'))"
        )
        figures = page.evaluate(
            "[...document.querySelectorAll('.figure')].map((one) => one.dataset.figure)"
        )
        linked = page.evaluate(
            "[...document.querySelectorAll('nav a')].every((a) => document.querySelector(a.hash))"
        )
        wide = [page.evaluate("document.documentElement.scrollWidth")]
        page.emulate_media(color_scheme="dark")
        page.set_viewport_size({"width": 420, "height": 900})
        wide.append(page.evaluate("document.documentElement.scrollWidth"))
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        with page.expect_download() as waiting:
            page.click("[data-csv=hazards]")
        header = waiting.value.path().read_text(encoding="utf-8").splitlines()[0]
        browser.close()
    assert figures == [
        "hazard-figure-1",
        "hazard-figure-2",
        "hazard-figure-3",
        "overview-figure",
        "loop-figure",
    ]
    assert linked and wide[0] <= 1280 and wide[1] <= 420 and ground == "rgb(15, 18, 21)"
    assert header.startswith("session,participant,group")
    assert (
        told == []
        and [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    )
