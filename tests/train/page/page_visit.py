"""A window on the page in a real browser."""

import pytest
import waiting
from chromium import NEEDED

# two processes and a browser; `test_page_server` speaks to the same page without one
BROWSER = [NEEDED, pytest.mark.slow]
HERE = ("http://127.0.0.1", "ws://127.0.0.1", "data:", "blob:")
GAMEPAD = """
window.pad = null;
navigator.getGamepads = () => [window.pad];
window.squeeze = (buttons, axes) => { window.pad = { connected: true, mapping: "standard", axes,
  buttons: Array.from({ length: 17 }, (_, i) => ({ pressed: (buttons[i] ?? 0) > 0.5, value: buttons[i] ?? 0 })) }; };
"""  # noqa: E501


class Visit:
    """A window; close() fails where it asked another machine for anything, or told of an error."""

    def __init__(self, browser, session, query, width=1000):
        self.context = browser.new_context(viewport={"width": width, "height": 640})
        self.context.add_init_script(GAMEPAD)
        self.asked, self.told = [], []
        self.page = self.context.new_page()
        self.page.set_default_timeout(waiting.DEADLINE_MS)
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("websocket", lambda socket: self.asked.append(socket.url))
        self.page.on(
            "console",
            lambda message: self.told.append(message.text) if message.type == "error" else None,
        )
        self.page.on("pageerror", lambda error: self.told.append(str(error)))
        self.page.goto(f"http://127.0.0.1:{session.listens_at}/?{query}")
        until(self.page, "window.ravenjax?.state && window.ravenjax.state().frames > 3")

    def __enter__(self):
        return self.page

    def __exit__(self, kind, *_):
        self.context.close()
        if kind is None:
            assert (
                len(self.asked) > 3
                and [url for url in self.asked if not url.startswith(HERE)] == []
            )
            assert self.told == []


def until(page, expression):
    """Polled by the clock: animation frames are rare where a software renderer is busy."""
    page.wait_for_function(expression, polling=50)


def click(page, selector):
    """Without playwright's wait for a steady picture, which a software renderer takes long to
    give.
    """
    until(page, f"document.querySelector({selector!r})?.disabled === false")
    page.evaluate(f"document.querySelector({selector!r}).click()")
