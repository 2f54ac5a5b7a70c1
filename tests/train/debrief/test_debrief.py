"""The debrief: what it says, what it leaves open, and that it opens offline."""

import dataclasses
import re

import numpy as np
import pytest
import synthetic_session as synthetic
import waiting
from chromium import CHROMIUM, NEEDED

from ravenjax.cli import main
from ravenjax.errors import StoreError
from ravenjax.robots.raven2.geometry import scene
from ravenjax.store.logs.session import description, log
from ravenjax.train.debrief import figures
from ravenjax.train.debrief import page as debrief
from ravenjax.train.protocol import closing_point, to_world
from ravenjax.train.recording import reader, recorder

MET = synthetic.hazard(0)
MISSED = synthetic.hazard(1, struck=9000.0, cue=None, known=None, response=None, off=12.0, ok=False)
ALARMED = synthetic.hazard(2, struck=15_000.0, alarm=240.0, response=380.0, off=3.8)
UNSTRUCK = synthetic.hazard(3, struck=None)
ARMS = ("gold", "green")
BASES = {
    arm: dict(zip(("origin", "quaternion"), scene.base_pose(arm), strict=True)) for arm in ARMS
}
TARGET = {"number": 0, "arm": "gold", "at": [0.0, 0.0, 0.19], "radius_m": 0.002}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One session with four hazards, written, debriefed and read by all tests."""
    made = synthetic.write(
        tmp_path_factory.mktemp("debrief") / "s",
        [MET, MISSED, ALARMED, UNSTRUCK],
        seconds=17.0,
        bases=BASES,
        task={"targets": [TARGET | {"colour": "#d9a441"}]},
    )
    debrief.write_debrief(made)
    return made


@pytest.fixture(scope="module")
def text(folder):
    return text_of((folder / debrief.FILE).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def recording(folder):
    return reader.read_recording(folder)


def text_of(html):
    """What a reader sees of a page, without scripts and drawings."""
    plain = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", plain))


def test_the_table_is_read_back_as_it_was_written(folder):
    found = reader.read_table(folder)
    assert found == [MET, MISSED, ALARMED, UNSTRUCK]
    assert found[2].times_after_activation == {
        **{"knowable": 35.0, "cue": 90.0, "alarm": 240.0, "response": 380.0}
    }
    assert found[3].times_after_activation == {} and reader.read_table(folder.parent) == []


def test_the_page_says_what_struck_when_it_could_be_known_and_how_it_was_met(text):
    assert "2 of 3 hazards met with the right response" in text
    # Reactions of 395 and 345 ms.
    assert "370 ms reaction, median" in text and "12.0 mm largest unintended motion" in text
    course = " first sign 35 ms after the start · tip → cue 90 ms after the start →"
    assert f"start at 2.0 s →{course} response 430 ms after the start · lifted the pedal" in text
    assert f"start at 15.0 s →{course} robot&#39;s alarm 240 ms" in text.replace("'", "&#39;")
    assert "none right: release" in text and "armed, never active" in text
    assert "Motion hazard while the robot was live: unintended motion (limit 8 mm)" in text


def test_waiting_costs_a_row_a_second_and_neither_it_nor_a_pause_is_drawn(tmp_path):
    layout = synthetic.FrameLayout.of(("gold",))
    rows = synthetic.rows(layout, [], 5.0)
    rows[:, layout.places["left_ms"]] = np.minimum(2000, 5000 - np.arange(5000))[:, None]
    rows[:3000, layout.places["pedal"]] = 0
    rows[4400:4600, layout.places["session_tick"]] = 4400
    rows[4600:, layout.places["session_tick"]] -= 199
    writer = recorder.RowWriter(tmp_path, layout.names(), {"scenario": {"duration_s": 2.0}})
    written = sum(writer.add(k, rows[k : k + 128], []) for k in range(0, 5000, 128))
    writer.add(5000, rows[:0], [{"tick": 3000, "kind": "started", "by": "pedal"}])
    writer.log.close()
    recording = reader.read_recording(tmp_path, debrief.CHANNELS)
    assert recording.numbers.tolist() == [0, 1000, 2000, *range(3000, 5000)]
    assert len(recording.rows) == written and "gold/jpos" not in recording.layout.places
    np.testing.assert_array_equal(recording.without_pauses().ms, np.arange(1801))


def test_the_page_is_honest_about_what_is_missing(tmp_path):
    bare = synthetic.write(tmp_path / "bare", None, recorded=False, ended=None, summary={})
    told = text_of(debrief.write_debrief(bare).read_text())
    assert "The hazards are not known" in told and "There is no recording" in told

    cut = synthetic.write(tmp_path / "cut", [MET, ALARMED], seconds=8.0, cue_threshold_mm=9.0)
    data = (cut / log.FILE).read_bytes()
    (cut / log.FILE).write_bytes(data[: len(data) // 2])
    told = text_of(debrief.write_debrief(cut).read_text())
    assert "The recording was cut short" in told and "ravenjax log recover" in told
    assert "The recording ends before this hazard" in told

    (cut / log.FILE).write_bytes(b"nothing")
    assert "cannot be read" in text_of(debrief.write_debrief(cut).read_text())
    with pytest.raises(StoreError, match="not the folder of a session"):
        debrief.write_debrief(tmp_path)


def test_hazards_of_a_killed_session_come_from_its_events(tmp_path):
    layout = synthetic.FrameLayout.of(("gold",))
    armed = {"hazard": MET.hazard, "title": MET.title, "right_response": "release", "number": 0}
    armed |= {"limit_mm": MET.limit_mm, "cue": "on"}
    header = {"name": MET.session, "ended": None, "arms": ["gold"]} | {
        "scenario": {"name": MET.scenario, "harm": {"excursion_mm": MET.limit_mm}},
        **{"participant": MET.participant, "group": MET.group, "seed": 7, "cue": True},
    }
    told = [
        {"tick": 1000, "kind": "started", "by": "pedal"},
        {"tick": 1500, "kind": "hazard_armed", "row": armed | {"armed_ms": 1500}},
        {"tick": 2000, "kind": "hazard_struck", "number": 0},
        {"tick": 3400, "kind": "hazard_over", "number": 0, "outcome": MET.outcome},
        {"tick": 3400, "kind": "hazard_row", "row": dataclasses.asdict(MET)},
        {"tick": 3900, "kind": "hazard_armed", "row": armed | {"armed_ms": 3900}},
        {"tick": 3950, "kind": "hazard_struck", "number": 0},
    ]
    synthetic.write(tmp_path, None, recorded=False, **header)
    writer = log.SessionWriter(tmp_path / log.FILE, layout.names(), header)
    writer.add(0, synthetic.rows(layout, [MET], 4.0), told)
    writer.close()
    data = (tmp_path / log.FILE).read_bytes()
    # It never came to its end.
    (tmp_path / log.FILE).write_bytes(data[:-40])
    first, second = reader.from_recording(reader.read_recording(tmp_path), header)
    assert (first.number, first.struck_ms, first.cue_ms, first.halted_ms) == (1, 1000, 1090, 0)
    assert (second.number, second.struck_ms, second.outcome, second.score) == (2, 2950, "", None)
    assert main(["log", "debrief", str(tmp_path)]) == 0
    assert main(["log", "debrief", str(tmp_path / "none")]) == 2
    page = text_of((tmp_path / debrief.FILE).read_text())
    assert (
        "reads the hazards from the recording" in page and "Not counted: 1 × the outcome is" in page
    )
    assert "1 of 1 hazard that left room for a response met with the right response" in page
    assert "The outcome is not known" in page


def test_hazards_that_left_no_room_do_not_count_and_no_text_becomes_markup(tmp_path):
    title = "<script>alert(1)</script>"
    halted = dataclasses.replace(MISSED, outcome="halted", score=50.0, title=title)
    made = synthetic.write(tmp_path / "s", [MET, halted], recorded=False, participant="<b>P</b>")
    html = debrief.write_debrief(made).read_text()
    assert "<script>alert" not in html.lower() and "<b>P</b>" not in html and "&lt;b&gt;P" in html
    told = text_of(html)
    assert "1 of 1 hazard that left room for a response met with the right response" in told
    assert "Not counted: 1 × the robot halted on its own before a right response." in told
    assert "82 score of 100, mean of 1 hazard" in told and "Halted :" in told
    idle = synthetic.write(tmp_path / "idle", [], seconds=0.3)
    assert "Nobody drove" in text_of(debrief.write_debrief(idle).read_text())


def test_a_blinded_session_tells_nothing_of_cue_and_group(tmp_path):
    made = synthetic.write(tmp_path, [MET], seconds=4.0, blinded=True, group="treated", bases=BASES)
    html = debrief.write_debrief(made).read_text()
    told = text_of(html).lower()
    assert "treated" not in html and "90 ms" not in told and "with the cue" not in told
    assert "force felt" not in told and "unintended motion" in told and '"model"' not in html


def test_the_replay_has_the_worlds_places_and_a_mark_for_every_hazard(recording, folder):
    told = figures.player_data(recording.without_pauses(), description.read_session(folder), [MET])
    assert told is not None
    ms = np.array(told["ms"])
    assert ms[0] == 0 and ms[-1] == 16_999 and len(ms) < 1500
    assert np.diff(ms).max() <= figures.INTERVAL_MS
    assert np.diff(ms[(ms > 2000) & (ms < 4900)]).max() <= figures.HAZARD_INTERVAL_MS
    row = int(np.searchsorted(ms, 2400))
    for arm in ARMS:
        axis, joints = (
            recording[f"{arm}/{name}"][ms[row]].tolist() for name in ("tip", "link_jpos")
        )
        place = np.array(told["arms"][arm]["tip"][row]) / figures.UNITS_PER_M
        assert np.allclose(place, to_world(arm, closing_point(arm, axis, joints)), atol=1e-4)
    marks = [(ms, kind) for kind, ms, _ in told["marks"]]
    assert marks == [(2000.0, "strike"), (2430.0, "response")]
    assert told["task"]["targets"][0]["at"] == [0.0, 0.0, 0.19]
    assert figures.player_data(recording.without_pauses(), {}, [MET]) is None


@NEEDED
@pytest.mark.slow
def test_the_page_opens_offline_fits_and_plays_the_session_again(folder):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    asked, told = [], []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(waiting.DEADLINE_MS)
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: told.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: told.append(str(error)))
        page.goto((folder / debrief.FILE).as_uri())
        linked = page.evaluate(
            "[...document.querySelectorAll('nav a')].every((a) => document.querySelector(a.hash))"
        )
        picture = "document.querySelector('canvas.replay').toDataURL()"
        pictures = [page.evaluate(picture)]
        page.evaluate(
            "Object.assign(document.querySelector('.player input'), {value:"
            " 1500}).dispatchEvent(new Event('input'))"
        )
        assert page.inner_text(".player output") == "1.50 s of 17.0 s"
        pictures.append(page.evaluate(picture))
        page.evaluate("document.querySelector('.moments .strike').click()")
        assert page.inner_text(".player output") == "1.80 s of 17.0 s"
        page.evaluate("document.querySelector('[data-view=side]').click()")
        pictures.append(page.evaluate(picture))
        page.select_option(".player select", "4")
        page.evaluate("document.querySelector('.player .play').click()")
        page.wait_for_function(
            "document.querySelector('.player .play').textContent === 'Play'", polling=50
        )
        assert page.inner_text(".player output").startswith("17.00")
        wide = [page.evaluate("document.documentElement.scrollWidth")]
        page.emulate_media(color_scheme="dark")
        page.set_viewport_size({"width": 420, "height": 900})
        wide.append(page.evaluate("document.documentElement.scrollWidth"))
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        browser.close()
    assert linked and wide[0] <= 1280 and wide[1] <= 420 and ground == "rgb(15, 18, 21)"
    assert len(set(pictures)) == 3 and told == []
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
