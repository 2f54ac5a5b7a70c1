"""Whole sessions with a real browser, and a console that was written from the protocol alone:
who drives, and when.
"""

from __future__ import annotations

import contextlib
import csv
import shutil
import time

import pytest
import waiting
from foot import hold_pedal
from live_session import HeldConsole, LiveSession

from ravenjax.train.recording import reader

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
pytestmark = [
    pytest.mark.skipif(
        CHROMIUM is None, reason="no chromium on the path (apt-get install chromium)"
    ),
    pytest.mark.slow,  # sessions against the clock
]
SCENARIO = """
name = "fair"
duration_s = {seconds}
arms = ["gold"]
[task]
kind = "free"
[[hazard]]
when = {when}
within_s = 1.5
right_response = ["release"]
[[hazard.fault]]
site = "usb_out"
channel = "shoulder"
effect = "overwrite"
value = 6000
duration_ms = 40
"""


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield launched
        launched.close()


@pytest.fixture
def begin(tmp_path):
    """Begins a session; ends it with the test."""
    with contextlib.ExitStack() as stack:

        def started(seconds=8, when='"instructor"', folder="session", options=()):
            file = tmp_path / "fair.toml"
            file.write_text(SCENARIO.format(seconds=seconds, when=when))
            session = LiveSession(file, tmp_path / folder, *options)
            stack.callback(session.close)
            return session

        yield started


@contextlib.contextmanager
def visit(browser, address):
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    page = context.new_page()
    page.set_default_timeout(waiting.DEADLINE_MS)
    page.goto(f"{address}&scene=off")
    page.wait_for_function(
        "window.ravenjax.state && window.ravenjax.state().frames > 3", polling=50
    )
    try:
        yield page
    finally:
        context.close()


@contextlib.contextmanager
def console(session):
    held = HeldConsole(session.console)
    try:
        yield held
    finally:
        held.close()


def until(page, expression, **options):
    page.wait_for_function(expression, polling=50, **options)


def number(page, name):
    return page.evaluate(f"window.ravenjax.state().latest.number({name!r})")


def became(page, name, value, **options):
    until(page, f"window.ravenjax.state().latest?.number({name!r}) === {value}", **options)


def hazards(session):
    with open(session.folder / "hazards.csv", newline="") as file:
        return list(csv.DictReader(file))


def events(session, kind):
    return [one for one in reader.read(session.folder).events if one["kind"] == kind]


def test_handing_over_is_an_act_that_is_seen_and_recorded(browser, begin):
    session = begin(seconds=60)
    with (
        visit(browser, session.operator) as page,
        visit(browser, session.instructor) as instructor,
        console(session) as held,
    ):
        waiting.until(lambda: held.sent > 50)
        held.pedal = 1
        became(page, "pedal", 1)
        held.pedal = 0
        became(page, "pedal", 0)
        page.click("#take")
        until(page, "document.getElementById('owner').textContent === 'the page'")
        held.pedal = 1
        hold_pedal(page)
        became(page, "pedal", 1)
        assert held.told()["jointflags"] & 0b10_0100 == 0  # it watches
        instructor.click("[data-give=itp]")  # at any time; both feet are down now
        until(instructor, "document.getElementById('owner').textContent === 'the ITP console'")
        became(page, "pedal", 0)
        time.sleep(0.3)
        assert number(page, "pedal") == 0  # the console's foot never came up
        held.pedal = 0
        time.sleep(0.1)
        held.pedal = 1
        became(page, "pedal", 1)
        for _ in range(2):
            instructor.click("[data-instructor=end]")
        assert session.ended() == 0
    told = [(one["console"], one["by"]) for one in events(session, "owner")]
    assert told == [("itp", "pedal"), ("page", "operator"), ("itp", "instructor")]
