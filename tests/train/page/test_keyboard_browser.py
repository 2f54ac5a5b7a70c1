"""Every control of the training page by the keyboard alone, in a browser: reached, outlined,
named, pressed.
"""

from __future__ import annotations

import shutil

import pytest
from fake_session import AS_INSTRUCTOR, FakeSession
from test_page_browser import CHROMIUM, FLAT, Visit, until

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = [
    pytest.mark.skipif(
        CHROMIUM is None or shutil.which("chromium") is None, reason="no chromium on the path"
    ),
    pytest.mark.slow,  # a process and a browser
]
CONTROLS = """
window.controls = [...document.querySelectorAll("#rj :is(button, input, select, textarea, a[href])")]
  .filter((one) => one.offsetParent && !one.disabled && one.tabIndex >= 0);
window.pressed = new Set();
document.addEventListener("click", (event) => {
  const one = event.target.closest("#rj button, #rj input[type=checkbox], #rj a");
  if (one) pressed.add(one);
  event.preventDefault();
  event.stopImmediatePropagation();
}, { capture: true });
window.words = (one) => (one.ariaLabel ?? one.labels?.[0]?.textContent ?? one.textContent).trim();
controls.map((one) => one.outerHTML);
"""  # noqa: E501
FOCUSED = """(() => {
  const one = document.activeElement;
  return { number: controls.indexOf(one), outlined: getComputedStyle(one).outlineStyle !== "none",
    presses: one.matches("button, a, input[type=checkbox]") };
})()"""


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAT)
        yield launched
        launched.close()


@pytest.mark.parametrize(("role", "least"), [("role=operator", 15), (AS_INSTRUCTOR, 15)])
def test_every_control_is_reached_by_tab_outlined_named_and_pressed_by_enter(browser, role, least):
    session = FakeSession()
    session.wait()
    with Visit(browser, session, f"{role}&scene=off", 1366) as page:
        until(page, "window.ravenjax.state().frames > 3")
        controls = page.evaluate(CONTROLS)
        assert len(controls) >= least
        reached, outlined = set(), set()
        for _ in range(2 * len(controls) + 10):  # summaries and lists that scroll are reached, too
            page.keyboard.press("Tab")
            focused = page.evaluate(FOCUSED)
            reached.add(focused["number"])
            if focused["outlined"]:
                outlined.add(focused["number"])
            if focused["presses"]:
                page.keyboard.press("Enter")
        assert [one for number, one in enumerate(controls) if number not in reached] == []
        assert [one for number, one in enumerate(controls) if number not in outlined] == []
        assert (
            page.evaluate("controls.filter((one) => !words(one)).map((one) => one.outerHTML)") == []
        )
        assert (
            page.evaluate(
                "controls.filter((one) => one.matches('button, input[type=checkbox]') &&"
                " !pressed.has(one)).map((one) => one.outerHTML)"
            )
            == []
        )
    session.close()
