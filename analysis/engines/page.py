"""Measures how long a reader waits for the page of `ravenjax explore`.

    python analysis/engines/page.py [CAMPAIGN] [ROUNDS]    # needs playwright and Chromium

Opens the page from a file in Chromium with software rendering, each time in a new browser. Measures
the time until 400 points of the map, and all points, are shown. In the last browser the script also
measures the longest task of the page's main thread: while the page opens, after a control moves,
while a run opens, and while the user moves the time slider.
"""

import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from ravenjax.analyses.explorer import page

ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
WATCH = """
window.tasks = [];
new PerformanceObserver((list) => list.getEntries().forEach((one) => window.tasks.push(one.duration)))
  .observe({ type: "longtask", buffered: true });
"""  # noqa: E501


def longest(shown: Page) -> str:
    """Return the longest task since the last call. The browser reports tasks of 50 ms and more."""
    tasks = shown.evaluate("window.tasks.splice(0)")
    return f"{max(tasks):.0f} ms" if tasks else "below 50 ms"


def filled(shown: Page) -> None:
    """Wait for the whole map."""
    shown.wait_for_function("document.body.dataset.filled === '1'")


def used(shown: Page) -> dict[str, str]:
    """Return the longest task while the page is used."""
    found = {"while it opens and fills the map": longest(shown)}
    shown.select_option("#channel", index=1)
    filled(shown)
    found["after a control moved"] = longest(shown)
    box = shown.locator("#field").bounding_box()
    assert box is not None
    shown.locator("#field").click(position={"x": 0.9 * box["width"], "y": 0.35 * box["height"]})
    shown.wait_for_selector("#run:not([hidden])")
    time.sleep(2.0)
    found["while a run opened"] = longest(shown)
    for at in range(600, 1600, 20):
        shown.locator("#time").fill(str(at))
    found["while a hand scrubbed"] = longest(shown)
    return found


def main(campaign: str = "quick", rounds: str = "5") -> None:
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        place = page.build_page(campaign, Path(folder) / "page.html")
        times: list[list[float]] = []
        found: dict[str, str] = {}
        for number in range(int(rounds)):
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=ARGUMENTS
            )
            shown = browser.new_page(viewport={"width": 1366, "height": 900})
            time.sleep(3.0)  # time for the browser's own start
            shown.add_init_script(WATCH)
            shown.goto(place.as_uri())
            filled(shown)
            times.append(
                shown.evaluate("[document.body.dataset.first * 1e-3, performance.now() * 1e-3]")
            )
            if number == int(rounds) - 1:
                found = used(shown)
            browser.close()
        print(
            f"{place.stat().st_size / 1e6:.1f} MB; {os.cpu_count()} cores, load"
            f" {os.getloadavg()[0]:.1f}"
        )
        for name, each in zip(("400 points", "all points"), zip(*times, strict=True), strict=True):
            print(
                f"{name}: {statistics.median(each):.2f} s after opening, {min(each):.2f} to"
                f" {max(each):.2f}"
            )
        for name, told in found.items():
            print(f"longest task {name}: {told}")


if __name__ == "__main__":
    main(*sys.argv[1:])
