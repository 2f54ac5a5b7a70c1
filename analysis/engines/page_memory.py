"""Measures whether the memory of the page of `ravenjax explore` grows during uninterrupted use.

    python analysis/engines/page_memory.py [CAMPAIGN] [MINUTES]    # needs playwright and Chromium

The script repeatedly selects another start of the fault, another joint, another run and another
time. Once a minute it prints the number of rounds, the page's own heap after a collection, and the
proportional resident memory (PSS) of all processes of the browser. These include the worker that
draws the robot.
"""

import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

from page import ARGUMENTS, filled
from playwright.sync_api import CDPSession, Page, sync_playwright

from ravenjax.analyses.explorer import page

EVERY_S = 60.0


def one_round(shown: Page, number: int) -> None:
    """Select another start, map, run and moment."""
    shown.select_option("#channel", index=number % 3)
    shown.locator("#f-start_ms-number").fill(str(600 + 37 * number % 800))
    filled(shown)
    box = shown.locator("#field").bounding_box()
    assert box is not None
    across, down = 0.1 + 0.8 * (0.37 * number % 1.0), 0.1 + 0.8 * (0.61 * number % 1.0)
    shown.locator("#field").click(position={"x": across * box["width"], "y": down * box["height"]})
    shown.wait_for_selector("#run:not([hidden])")
    for at in range(600, 1600, 100):
        shown.locator("#time").fill(str(at))


def heap_mb(session: CDPSession) -> float:
    """Return the heap of the page after a collection."""
    session.send("HeapProfiler.collectGarbage")
    return session.send("Runtime.getHeapUsage")["usedSize"] / 1e6


def browser_mb() -> float:
    """Return the PSS of all processes below this one."""
    return sum(map(_pss_mb, _below(os.getpid())))


def _below(process: int) -> list[int]:
    children = [
        int(n)
        for file in Path(f"/proc/{process}/task").glob("*/children")
        for n in file.read_text().split()
    ]
    return [*children, *(deeper for child in children for deeper in _below(child))]


def _pss_mb(process: int) -> float:
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:  # the process ended meanwhile
        return 0.0
    return next(
        (int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("Pss:")), 0.0
    )


def main(campaign: str = "quick", minutes: str = "10") -> None:
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        place = page.build_page(campaign, Path(folder) / "page.html")
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=ARGUMENTS
        )
        shown = browser.new_page(viewport={"width": 1366, "height": 900})
        session = shown.context.new_cdp_session(shown)
        shown.goto(place.as_uri())
        filled(shown)
        print("| s | rounds | heap, MB | browser, MB |\n|---|---|---|---|")
        began, number, told = time.monotonic(), 0, -EVERY_S
        while told < 60 * float(minutes):
            if (passed := time.monotonic() - began) >= told + EVERY_S:
                told = passed
                print(
                    f"| {passed:.0f} | {number} | {heap_mb(session):.1f} | {browser_mb():.0f} |",
                    flush=True,
                )
            one_round(shown, number)
            number += 1
        browser.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
