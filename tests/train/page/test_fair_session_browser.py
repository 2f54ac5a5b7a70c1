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


@pytest.mark.parametrize("who", ["page", "itp"])
def test_a_foot_that_never_came_up_drives_nothing_after_a_stop_a_pause_or_a_silence(
    browser, begin, who
):
    session = begin(seconds=120)
    with (
        visit(browser, session.operator) as page,
        visit(browser, session.instructor) as instructor,
        console(session) as held,
    ):
        waiting.until(lambda: held.sent > 50)

        def foot(down):
            if who == "itp":
                held.pedal, held.um = int(down), 50
            else:
                page.bring_to_front()
                for key in ("Space", "KeyD"):
                    (page.keyboard.down if down else page.keyboard.up)(key)

        def tip():
            return page.evaluate("Array.from(window.ravenjax.state().latest.get('gold/tip'))")

        def drives():
            """Lifts the foot and steps on the pedal; again where a busy machine's silence has
            let go of it.
            """

            def tried():
                foot(False)
                time.sleep(0.2)
                foot(True)
                try:
                    became(page, "runlevel", 3, timeout=10_000)
                except sync_api.TimeoutError:
                    return False
                return True

            waiting.until(tried)

        def drives_after_lifting_only():
            became(page, "pedal", 0)
            before = tip()
            time.sleep(0.6)
            assert number(page, "pedal") == 0
            assert max(abs(a - b) for a, b in zip(tip(), before, strict=True)) < 2e-4
            drives()

        drives()
        instructor.click("[data-instructor=pause]")
        until(page, "document.getElementById('phase').textContent === 'paused'")
        instructor.click("[data-instructor=resume]")
        drives_after_lifting_only()
        page.evaluate("document.getElementById('estop').click()")
        until(page, "document.getElementById('phase').textContent === 'stopped'")
        page.click("[data-operator=restart]")
        drives_after_lifting_only()
        instructor.click("[data-instructor=reset]")
        drives_after_lifting_only()
        for _ in range(2):
            instructor.click("[data-instructor=end]")
        assert session.ended() == 0


def test_time_waits_for_the_first_pedal_and_is_shown(browser, begin):
    session = begin(seconds=3)
    with visit(browser, session.operator) as page:
        time.sleep(4)  # longer than it lasts
        assert page.inner_text("#left") == "0:03.0" and page.inner_text("#phase") == "ready"
        hold_pedal(page)
        until(page, "document.getElementById('left-word').textContent === 'left'")
        until(page, "document.getElementById('phase').textContent === 'over'")
        assert page.inner_text("#left") == "0:00.0"
        assert session.ended() == 0
    began = events(session, "started")[0]["tick"]
    assert began > 4000 and events(session, "end")[0]["tick"] == began + 2999


def test_a_session_is_never_overwritten(begin):
    folders = []
    for _ in range(2):
        session = begin(seconds=1, options=("--script", "none"))
        assert session.ended() == 0
        folders.append(session.said("session: ").partition(" (")[0])
    assert folders == [str(session.folder), f"{session.folder}-2"]
    assert "stays as it is; this one goes to" in "".join(session.lines)
