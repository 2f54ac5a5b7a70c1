"""The debrief: what it says, what it leaves open, and that it opens offline."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest
import synthetic_session as synthetic

from ravenjax.cli import main
from ravenjax.store import session_log
from ravenjax.store.files import StoreError
from ravenjax.trainer import (
    debrief,
    debrief_course,
    debrief_figures,
    debrief_words,
    hazard_events,
    hazard_table,
    recording,
)

MET = synthetic.hazard(0)
MISSED = synthetic.hazard(1, struck=9000.0, cue=None, known=None, response=None, stray=12.0, ok=False)
ALARMED = synthetic.hazard(2, struck=15_000.0, alarm=240.0, response=380.0, stray=3.8)
UNSTRUCK = synthetic.hazard(3, struck=None)
CARRIED_ON = synthetic.hazard(
    4, struck=4000.0, response=None, response_ok=True, right_response="continue", outcome="avoided", what="continue"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = synthetic.write(tmp_path_factory.mktemp("debrief") / "s", [ALARMED, UNSTRUCK, MET, MISSED], seconds=20.0)
    debrief.write(made)
    return made


def text_of(html):
    """What a reader sees of a page, without scripts."""
    plain = re.sub(r"<(script|style)\b.*?</\1>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", plain))


def test_the_table_is_read_back_as_it_was_written(folder):
    found = hazard_table.read(folder)
    assert found == [MET, MISSED, ALARMED, UNSTRUCK]  # in order of the strike
    assert found[2].after == {"knowable": 35.0, "cue": 90.0, "alarm": 240.0, "response": 380.0}
    assert found[3].after == {} and hazard_table.read(folder.parent) == []


def test_a_damaged_table_is_named(tmp_path):
    synthetic.write(tmp_path, [MET], recorded=False)
    path = tmp_path / "hazards.csv"
    whole = path.read_text()
    path.write_text(whole.replace("2430.0", "soon"))
    with pytest.raises(StoreError, match="line 2: response_ms is 'soon', expected a number"):
        hazard_table.read(tmp_path)
    path.write_text(whole.replace("response_ms", "answer"))
    with pytest.raises(StoreError, match="no column response_ms"):
        hazard_table.read(tmp_path)


def test_a_hazard_in_words():
    told = debrief_words.sentence(MET, blinded=False)
    assert told == (
        "It struck at 2.0 s on the gold arm. Anyone could have known after 35 ms, by the measured tip. The cue came "
        "after 90 ms; the operator lifted the pedal after 430 ms, 395 ms after the first sign: the right response. "
        "No harm was done: the tip strayed 6.5 mm and it was 1.5 mm deep in the tissue."
    )
    assert "cue" not in debrief_words.sentence(MET, blinded=True).lower()
    told = debrief_words.sentence(MISSED, blinded=False)
    assert "Nothing that the robot measures gave it away. No response followed (right: lift the pedal)." in told
    assert debrief_words.sentence(UNSTRUCK, blinded=False) == "It was armed and never struck."
    told = debrief_words.sentence(CARRIED_ON, blinded=True)  # to carry on has no moment
    assert "The operator carried on, the right response." in told


def test_steps_stand_in_order_of_time_and_what_never_came_last():
    late = synthetic.hazard(0, cue=500.0, alarm=20.0, response=100.0)
    steps = debrief_words.steps(late, blinded=False)
    assert [one.kind for one in steps] == ["strike", "alarm", "knowable", "response", "cue"]
    steps = debrief_words.steps(synthetic.hazard(0, cue=None, response=None), blinded=False)
    assert [(one.kind, one.after_ms) for one in steps[2:]] == [("cue", None), ("alarm", None), ("response", None)]
    assert "cue" not in [one.kind for one in debrief_words.steps(late, blinded=True)]


def test_the_summary_counts_right_responses_only():
    wrong = synthetic.hazard(1, response=200.0, ok=False)
    numbers = debrief_words.summary([MET, MISSED, wrong, ALARMED, UNSTRUCK, CARRIED_ON])
    assert (numbers.struck, numbers.right, numbers.timed) == (5, 3, 2)
    assert numbers.reaction_ms == np.median([395.0, 345.0]) and numbers.stray_mm == 12.0
    assert debrief_words.headline([], debrief_words.summary([]), True) == ("No hazard struck", " in this session.")


def test_curves_meet_the_recording(folder):
    course = debrief_course.Course(recording.read(folder), 3.0)
    figure = json.loads(debrief_figures.hazard(course, MET, debrief_words.steps(MET, False)).json)
    stray = next(one for one in figure["data"] if one["name"] == "true tip off its course")
    assert max(stray["y"]) == pytest.approx(MET.peak_stray_mm, rel=1e-3)
    assert stray["x"][int(np.argmax(stray["y"]))] == 430  # where the operator let go
    pedal = [one for one in figure["data"] if one["type"] == "bar" and one["y"][0] == "pedal"]
    up = next(one for one in pedal if one["text"][0] == "up")
    assert (up["base"], up["x"]) == ([430], [700])
    lines = [one["x0"] for one in figure["layout"]["shapes"] if one.get("yref") == "paper"]
    assert lines == [0, 35, 90, 430]
    threshold = next(one for one in figure["layout"]["shapes"] if one["yref"] == "y")
    assert threshold["y0"] == threshold["y1"] == 3.0
    assert debrief_figures.hazard(course, synthetic.hazard(0, struck=60_000.0), []) is None


def test_thinning_keeps_every_peak():
    time, values = np.arange(100_000.0), np.zeros(100_000)
    values[[17, 54_321, 99_998]] = 1, 2, 3
    x, y = debrief_course.peaks(time, values)
    assert len(x) < 1000 and {17, 54_321, 99_998} <= set(x) and y.sum() == 6 and (np.diff(x) > 0).all()


def test_pauses_are_left_out(tmp_path):
    layout = synthetic.Layout.of(("gold",))
    rows = synthetic.rows(layout, [], 1.0)
    rows[400:600, layout.places["session_tick"]] = 400
    rows[600:, layout.places["session_tick"]] -= 199
    writer = session_log.Writer(tmp_path / session_log.FILE, layout.names(), {})
    writer.add(0, rows)
    writer.close()
    course = debrief_course.Course(recording.read(tmp_path), 3.0)
    np.testing.assert_array_equal(course.ms, np.arange(801))


def test_the_page_is_honest_about_what_is_missing(tmp_path):
    bare = synthetic.write(tmp_path / "bare", None, recorded=False, ended=None, summary={})
    told = text_of(debrief.render(bare))
    assert "Nothing is known of hazards" in told and "did not end by itself" in told
    assert "There is no recording" in told and "Nobody timed this session" in told

    cut = synthetic.write(tmp_path / "cut", [MET, ALARMED], seconds=8.0)
    data = (cut / session_log.FILE).read_bytes()
    (cut / session_log.FILE).write_bytes(data[: len(data) // 2])
    told = text_of(debrief.render(cut))
    assert "The recording was cut short" in told and "ravenjax log recover" in told
    assert "The recording does not reach this hazard" in told

    (cut / session_log.FILE).write_bytes(b"nothing")
    assert "cannot be read" in text_of(debrief.render(cut))
    with pytest.raises(StoreError, match="not the folder of a session"):
        debrief.write(tmp_path)


def test_hazards_of_a_killed_session_come_from_its_events(tmp_path):
    layout = synthetic.Layout.of(("gold",))
    header = {"name": "s", "cue": True, "arms": ["gold"], "ended": None, "scenario": {"name": "x"}} | {
        "hazards": [{"number": 4, "hazard": "C09", "title": "encoder", "right_response": ["release", "stop"]}]
    }
    told = [
        {"tick": 1500, "kind": "hazard_armed", "number": 4},
        {"tick": 2000, "kind": "hazard_struck", "number": 4},
        {"tick": 2035, "kind": "knowable", "number": 4, "by": "tip"},
        {"tick": 2060, "kind": "alarm", "check": "overdrive"},
        {"tick": 2090, "kind": "cue", "number": 4, "arm": "gold", "felt": True},
        {"tick": 2200, "kind": "response", "number": 4, "what": "slow", "ok": False, "ms": 165},
        {"tick": 2430, "kind": "response", "number": 4, "what": "release", "ok": True, "ms": 395},
        {"tick": 3400, "kind": "hazard_over", "number": 4, "outcome": "avoided", "score": 82.0},
        {"tick": 3500, "kind": "cue", "number": -1, "arm": "gold", "felt": True},
        {"tick": 3900, "kind": "hazard_armed", "number": 4},
        {"tick": 3950, "kind": "hazard_struck", "number": 4},
    ]
    synthetic.write(tmp_path, None, recorded=False, **header)
    writer = session_log.Writer(tmp_path / session_log.FILE, layout.names(), header)
    writer.add(0, synthetic.rows(layout, [MET], 4.0), told)
    writer.close()
    data = (tmp_path / session_log.FILE).read_bytes()
    (tmp_path / session_log.FILE).write_bytes(data[:-40])  # it never came to its end
    first, second = hazard_events.from_recording(recording.read(tmp_path), header)
    assert first.after == {"knowable": 35.0, "cue": 90.0, "alarm": 60.0, "response": 430.0}
    assert (first.response, first.response_ok, first.reaction_ms, first.outcome, first.score) == (
        *("release", True, 395.0, "avoided", 82.0),
    )
    assert first.peak_stray_mm == pytest.approx(6.5, rel=1e-3) and first.right_response == "release stop"
    assert second.struck_ms == 3950 and second.outcome == "" and second.score is None and second.response_ms is None
    assert main(["log", "debrief", str(tmp_path)]) == 0
    assert main(["log", "debrief", str(tmp_path / "none")]) == 2
    page = text_of((tmp_path / debrief.FILE).read_text())
    assert "put together from what the recording tells" in page and "1 of 2 hazards met" in page
    assert "How it ended is not known" in page


def test_a_blinded_session_tells_nothing_of_cue_and_group(tmp_path):
    made = synthetic.write(tmp_path, [MET], seconds=4.0, blinded=True, group="treated")
    html = debrief.render(made)
    table = json.loads(json.loads(json.dumps(re.search(r'id="csv-hazards">(.*?)</script>', html, re.S)[1])))
    assert "cue" not in table.splitlines()[0].split(",") and "treated" not in html
    assert "the cue came" not in text_of(html).lower() and "with the cue" not in text_of(html).lower()
    assert "force felt" not in html and "true tip off its course" in html


def test_text_from_a_session_cannot_become_markup(tmp_path):
    made = synthetic.write(tmp_path, [synthetic.hazard(0, title="<script>alert(1)</script>")], participant="<b>P</b>")
    html = debrief.render(made)
    assert "<script>alert" not in html.lower() and "<b>P</b>" not in html and "&lt;b&gt;P" in html


@pytest.mark.slow
def test_the_page_opens_offline_and_fits(folder):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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
            "[...document.querySelectorAll('.figure')].every((one) => one.querySelector('.main-svg'))"
        )
        figures = page.evaluate("[...document.querySelectorAll('.figure')].map((one) => one.dataset.figure)")
        linked = page.evaluate("[...document.querySelectorAll('nav a')].every((a) => document.querySelector(a.hash))")
        wide = [page.evaluate("document.documentElement.scrollWidth")]
        page.emulate_media(color_scheme="dark")
        page.set_viewport_size({"width": 420, "height": 900})
        wide.append(page.evaluate("document.documentElement.scrollWidth"))
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        with page.expect_download() as waiting:
            page.click("[data-csv=hazards]")
        header = waiting.value.path().read_text(encoding="utf-8").splitlines()[0]
        browser.close()
    assert figures == ["hazard-figure-1", "hazard-figure-2", "hazard-figure-3", "overview-figure", "loop-figure"]
    assert linked and wide[0] <= 1280 and wide[1] <= 420 and ground == "rgb(15, 18, 21)"
    assert header.startswith("session,participant,group")
    assert told == [] and [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
