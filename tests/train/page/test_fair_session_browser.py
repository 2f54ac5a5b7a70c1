"""Whole sessions with a real browser, and a console that was written from the protocol alone:
who drives, and when.
"""

import contextlib
import time

import pytest
import waiting
from foot import hold_pedal
from live_session import HeldConsole, LiveSession
from page_visit import BROWSER, until

from ravenjax.train.recording import reader

pytestmark = BROWSER
SCENARIO = """
name = "fair"
duration_s = 60
arms = ["gold"]
[task]
kind = "free"
"""


@pytest.fixture
def session(tmp_path):
    (tmp_path / "fair.toml").write_text(SCENARIO)
    with contextlib.closing(LiveSession(tmp_path / "fair.toml", tmp_path / "session")) as live:
        yield live


@contextlib.contextmanager
def visit(browser, address):
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    page = context.new_page()
    page.set_default_timeout(waiting.DEADLINE_MS)
    page.goto(f"{address}&scene=off")
    until(page, "window.ravenjax.state && window.ravenjax.state().frames > 3")
    try:
        yield page
    finally:
        context.close()


def number(page, name):
    return page.evaluate(f"window.ravenjax.state().latest.number({name!r})")


def became(page, name, value):
    until(page, f"window.ravenjax.state().latest?.number({name!r}) === {value}")


def events(session, kind):
    return [one for one in reader.read_recording(session.folder).events if one["kind"] == kind]


def test_handing_over_is_an_act_that_is_seen_and_recorded(browser, session):
    with (
        visit(browser, session.operator) as page,
        visit(browser, session.instructor) as instructor,
        contextlib.closing(HeldConsole(session.console)) as held,
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
