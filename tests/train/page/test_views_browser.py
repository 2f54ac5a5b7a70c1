"""The scene's second pictures in a real browser that draws in software: theatre, second scope,
stereo side by side.
"""

import pytest
import waiting
from chromium import ARGUMENTS, CHROMIUM
from fake_session import FakeSession
from page_visit import BROWSER, Visit, until

pytestmark = BROWSER
WIDTH = 1366
CAMERAS = {"theatre": "theatre", "second": "second", "stereo": "endoscope_right"}
DRAWS = "[...{}.querySelectorAll('canvas')].some((one) => one.width > 0 && one.clientWidth > 0)"
INSET = "document.getElementById('inset').contentDocument"
BOX = "JSON.parse(JSON.stringify(document.querySelector({!r}).getBoundingClientRect()))"


@pytest.fixture(scope="module")
def page(chromium):
    session = FakeSession()
    session.wait()
    browser = chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
    with Visit(browser, session, "role=operator&scene=on&quality=low", WIDTH) as opened:
        opened.set_default_timeout(3 * waiting.DEADLINE_MS)
        until(opened, DRAWS.format("document.getElementById('root')"))
        yield opened
    browser.close()
    session.close()


def box(page, name):
    return page.evaluate(BOX.format(name))


def apart(a, b):
    sides = (("left", "right"), ("top", "bottom"))
    return any(a[end] <= b[begin] + 1 or b[end] <= a[begin] + 1 for begin, end in sides)


@pytest.mark.parametrize(("key", "name"), [("5", "theatre"), ("6", "second"), ("7", "stereo")])
def test_a_key_adds_a_second_picture_and_takes_it_away(page, key, name):
    page.keyboard.press(key)
    until(
        page,
        f"document.body.dataset.inset === {name!r} && !document.getElementById('inset').hidden",
    )
    pressed = (
        "[...document.querySelectorAll('[data-inset][aria-pressed=true]')].map((one) =>"
        " one.dataset.inset).join()"
    )
    assert page.evaluate(pressed) == name
    assert page.evaluate("document.getElementById('inset').src").endswith(
        f"/?inset={CAMERAS[name]}"
    )
    until(page, f"{INSET} && {DRAWS.format(INSET)}")
    inset, field = box(page, "#inset"), box(page, "#root")
    for other in ("#hands", "#side-left", ".side.right", ".bar", "#goal-chip"):
        if name != "stereo" or other not in ("#hands", "#goal-chip"):  # these lie over both eyes
            assert apart(inset, box(page, other)), other
    if name == "stereo":
        assert apart(inset, field) and inset["width"] == pytest.approx(field["width"], abs=2)
        assert (inset["top"], inset["height"]) == pytest.approx(
            (field["top"], field["height"]), abs=2
        )
        assert page.evaluate("document.getElementById('rj').dataset.camera") == "endoscope_left"
    page.keyboard.press(key)
    until(page, "document.getElementById('inset').hidden")
    assert page.evaluate("document.getElementById('rj').dataset.camera") == "endoscope"
