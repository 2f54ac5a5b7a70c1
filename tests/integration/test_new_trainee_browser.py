"""Somebody without a manual does what the page says, no more: first goal, hazard and debrief in
three minutes.

Times are those of the session's clock: how long a busy machine takes for them says nothing of the
page.
"""

import csv
import re

import pytest
import waiting
from chromium import CHROMIUM, NEEDED
from live_session import LiveSession

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = [NEEDED, pytest.mark.slow]  # a session against the clock
SCENARIO = """
name = "first_day"
arms = ["gold"]
duration_s = 120
[task]
kind = "reach"
targets = 100
tolerance_mm = 3
dwell_ms = 200
[[hazard]]
times = 5  # one that a busy machine's silence cuts off is no loss
when = [30, 100]
right_response = ["release"]
within_s = 10
[[hazard.fault]]
site = "jpos_d"
channel = "shoulder"
effect = "drift"
value = 5e-5
duration_ms = 10000
"""
KEYS = {"A": "KeyA", "D": "KeyD", "W": "KeyW", "S": "KeyS", "R": "KeyR", "F": "KeyF"}
MM_S = 40.0  # faster than the hand: who undershoots comes near, who overshoots goes back and forth


@pytest.fixture
def session(tmp_path):
    scenario = tmp_path / "first_day.toml"
    scenario.write_text(SCENARIO)
    begun = LiveSession(scenario, tmp_path / "session")
    yield begun
    begun.close()


def test_who_is_new_reaches_a_goal_meets_a_hazard_and_reads_the_debrief_in_three_minutes(session):
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1366, "height": 768})
        page.set_default_timeout(waiting.DEADLINE_MS)
        page.goto(session.operator)
        page.wait_for_function(
            "!document.querySelector('#coach .begin')?.closest('[hidden]')", polling=50
        )
        assert (
            page.locator("#coach li >> visible=true")
            .first.inner_text()
            .startswith("Space is the foot pedal")
        )
        trainee = Trainee(page)
        waiting.until(trainee.does_what_is_said, every_s=0.05)
        page.wait_for_function("!document.getElementById('debrief').hidden", polling=50)
        told = page.frame_locator("#debrief iframe").locator(".headline").inner_text()
        browser.close()
    assert session.ended() == 0
    rows = list(csv.DictReader((session.folder / "hazards.csv").open(encoding="utf-8")))
    assert any((row["response"], row["response_ok"]) == ("release", "True") for row in rows), rows
    assert "hazard" in told
    assert trainee.reached_ms < 60_000 and trainee.over_ms < 180_000


class Trainee:
    """Reads the field; presses the keys that it names; lifts the pedal when it says that
    something is wrong.
    """

    def __init__(self, page):
        self.page = page
        self.reached_ms, self.over_ms = float("inf"), float("inf")

    def does_what_is_said(self):
        """One look and one act; whether the session is over."""
        seen = self.page.evaluate("""(() => {
            const one = (name) => document.querySelector(name);
            const shown = (name) => one(name)?.offsetParent ? one(name).innerText : "";
            const keys = [...document.querySelectorAll("#coach > p kbd")].map((key) => key.innerText);
            const frame = ravenjax.state().latest;
            return { line: shown("#coach > p"), keys,
              wrong: shown("#cue-sign") + shown("#alarm-words"), pedal: shown("#pedal-state"), phase: shown("#phase"),
              ms: frame.number("session_tick"), started: frame.number("left_ms") < 120000 };
        })()""")  # noqa: E501
        if not seen["started"]:
            self.began_ms = seen["ms"]
        if seen["phase"] == "over":
            self.over_ms = seen["ms"] - self.began_ms
            return True
        if "Goal reached" in seen["line"]:
            self.reached_ms = min(self.reached_ms, seen["ms"] - self.began_ms)
        if seen["wrong"] or "lift it first" in seen["pedal"]:
            self.page.keyboard.up("Space")
            self.page.wait_for_timeout(300)
        elif seen["pedal"] == "up":
            self.page.keyboard.down("Space")
        elif seen["keys"]:
            mm = float(re.search(r"(\d+) mm", seen["line"])[1])
            key = KEYS[seen["keys"][0]]
            self.page.keyboard.down(key)
            self.page.wait_for_timeout(1000 * mm / MM_S)
            self.page.keyboard.up(key)
        return False
