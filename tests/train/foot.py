"""A foot on the page's pedal, the space bar, as a person's: lifted and pressed again where the
pedal did not count.

On a busy machine a page is silent now and then for longer than a session waits for a console. Its
pedal then has to be seen up first, so that a key that is only held waits for ever.
"""

import waiting

_STATE = "document.getElementById('pedal-state').textContent"
_AGAIN_MS = 300


def hold_pedal(page) -> None:
    """Hold the pedal down; returns once the robot follows it."""

    def counts() -> bool:
        state = page.evaluate(_STATE)
        if state.startswith("down"):
            return True
        if state == "lift it first":
            page.keyboard.up("Space")
            page.wait_for_timeout(_AGAIN_MS)
        page.keyboard.down("Space")
        page.wait_for_timeout(_AGAIN_MS)
        return False

    waiting.until(counts, "the pedal never counted")
