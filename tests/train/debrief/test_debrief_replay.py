"""The replay of a session: its places are the world's, blinding holds, and the slider moves the
picture.
"""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import synthetic_session as synthetic
import waiting

from ravenjax.robots.raven2.geometry import scene
from ravenjax.train.debrief import page as debrief
from ravenjax.train.debrief import replay
from ravenjax.train.debrief.course import Course
from ravenjax.train.protocol.jaws import closing_point
from ravenjax.train.protocol.world import to_world
from ravenjax.train.recording import reader

ARMS = ("gold", "green")
BASES = {
    arm: dict(zip(("origin", "quaternion"), scene.base_pose(arm), strict=True)) for arm in ARMS
}
TASK = {
    "targets": [
        {"number": 0, "arm": "gold", "at": [0.0, 0.0, 0.19], "radius_m": 0.002, "colour": "#d9a441"}
    ]
}
MET = synthetic.hazard(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return synthetic.write(
        tmp_path_factory.mktemp("replay") / "s", [MET], seconds=5.0, bases=BASES, task=TASK
    )


def test_places_are_those_of_the_world_and_every_hazard_is_a_mark(folder):
    recording = reader.read(folder)
    told = replay.data(Course(recording), {"bases": BASES, "task": TASK}, [MET])
    assert told is not None
    ms = np.array(told["ms"])
    assert ms[0] == 0 and ms[-1] == 4999 and len(ms) < 1000
    assert np.diff(ms).max() <= replay.EVERY_MS
    assert np.diff(ms[(ms > 2000) & (ms < 4900)]).max() <= replay.EVERY_HAZARD_MS
    for arm in ARMS:
        row = int(np.searchsorted(ms, 2400))
        axis, joints = (
            recording[f"{arm}/{name}"][ms[row]].tolist() for name in ("tip", "link_jpos")
        )
        expected = to_world(arm, closing_point(arm, axis, joints))
        assert np.allclose(
            np.array(told["arms"][arm]["tip"][row]) / replay.PER_M, expected, atol=1e-4
        )
    assert [(one["ms"], one["kind"]) for one in told["marks"]] == [
        (2000.0, "strike"),
        (2430.0, "response"),
    ]
    assert told["task"]["targets"] == [{"number": 0, "at": [0.0, 0.0, 0.19]}]


def test_a_blinded_session_shows_no_model_and_one_without_bases_no_replay(folder):
    recording = reader.read(folder)
    told = replay.data(Course(recording, blinded=True), {"bases": BASES}, [])
    assert told is not None and all("model" not in one for one in told["arms"].values())
    assert replay.data(Course(recording), {}, [MET]) is None


@pytest.mark.slow
def test_the_slider_and_the_marks_move_the_picture(folder):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = (
        shutil.which("chromium")
        or shutil.which("chromium-browser")
        or shutil.which("google-chrome")
    )
    if chromium is None:
        pytest.skip("no chromium on the path (apt-get install chromium)")
    told = []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(waiting.DEADLINE_MS)
        page.on("pageerror", lambda error: told.append(str(error)))
        page.goto(debrief.write(folder).as_uri())
        picture = "document.querySelector('canvas.replay').toDataURL()"
        pictures = [page.evaluate(picture)]
        page.evaluate(
            "Object.assign(document.querySelector('.player input'), {value:"
            " 1500}).dispatchEvent(new Event('input'))"
        )
        assert page.inner_text(".player output") == "1.50 s of 5.0 s"
        pictures.append(page.evaluate(picture))
        page.evaluate("document.querySelector('.moments .strike').click()")
        assert page.inner_text(".player output") == "1.80 s of 5.0 s"
        page.evaluate("document.querySelector('[data-view=side]').click()")
        pictures.append(page.evaluate(picture))
        page.evaluate("document.querySelector('.player .play').click()")
        page.wait_for_function(
            "document.querySelector('.player output').textContent.startsWith('5.00')", polling=50
        )
        # 4.996 s reads 5.00 too: the button is Play again a frame later
        page.wait_for_function(
            "document.querySelector('.player .play').textContent === 'Play'", polling=50
        )
        browser.close()
    assert len(set(pictures)) == 3 and told == []
