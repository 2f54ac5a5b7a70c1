"""Takes screenshots of the training page: each task, role and screen size, the second pictures of
the scene, and each as seen by a person with protanopia.

    python analysis/training/screens.py FOLDER [--scenario first_steps,touch] [--scene]
    python analysis/training/screens.py docs/pictures --scenario creep --fault

Starts a session of each scenario, presses the pedal and moves; writes
FOLDER/SCENARIO-ROLE-SIZE[-protanope].png. With --scene the pictures are in 3D at 1366 px, drawn in
software if there is no graphics card: before the start, while driving, and each second picture.
With --fault it takes the picture of the README, FOLDER/training.webp: the scenario's first hazard
is active and the cue is on. With software rendering the page may be silent for longer than the
limit for consoles, so these sessions have a larger limit.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

SIZES = {"phone": (390, 844), "tablet": (820, 1180), "1366": (1366, 768), "1920": (1920, 1080)}
ROLES = ("operator", "instructor")
SCENARIOS = "first_steps,levels,path_network,peg_transfer,touch"
INSETS = ("theatre", "second", "stereo")
SOFTWARE = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
PEDAL, DOWN = "Space", "KeyF"
PATIENT = """from ravenjax.cli import main
from ravenjax.train import protocol
protocol.STALE_MS = 20000
from ravenjax.train.session import console_arbiter
console_arbiter.GONE_MS = 20000
main()
"""
# Tip error in the picture of a fault, at which the cue pulls.
FAULT_MM = 3.2
# A slow page turns the shadows off, which the pictures need.
SHADOWS = (
    "Object.defineProperty(document.getElementById('shadows'), 'checked', { get: () => true,"
    " set() {} })"
)
DOWN_MS = 400  # ms of motion down toward the tissue, without contact


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenario", default=SCENARIOS)
    parser.add_argument("--scene", action="store_true")
    parser.add_argument("--fault", action="store_true")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for scenario in given.scenario.split(","):
        with tempfile.TemporaryDirectory() as place:
            command = [
                sys.executable,
                "-c",
                PATIENT,
                "train",
                scenario,
                "--out",
                f"{place}/session",
            ]
            command += ["--port", "0", "--linger", "0"]
            session = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            try:
                way = _fault if given.fault else _scene if given.scene else _flat
                _take(session, given.folder / scenario, way)
            finally:
                session.terminate()
                session.wait(30)


def _take(
    session: subprocess.Popen[str], base: Path, way: Callable[[Browser, dict[str, str], Path], None]
) -> None:
    assert session.stdout is not None
    urls: dict[str, str] = {}
    for line in session.stdout:
        role, _, url = line.partition(": ")
        if role in ROLES:
            urls[role] = url.strip()
        # Before that, the page only asks to wait.
        if role == "realtime":
            break
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=SOFTWARE
        )
        way(browser, urls, base)
        browser.close()


def _flat(browser: Browser, urls: dict[str, str], base: Path) -> None:
    operator = _opened(browser, urls["operator"] + "&scene=off", *SIZES["1366"])
    instructor = _opened(browser, urls["instructor"] + "&scene=off", *SIZES["1366"])
    pages = {"operator": operator, "instructor": instructor}
    for name, size in SIZES.items():
        operator.set_viewport_size({"width": size[0], "height": size[1]})
        operator.wait_for_timeout(300)
        operator.screenshot(path=f"{base}-before-{name}.png")
    _drive(operator, 6000)
    for role, page in pages.items():
        for name, size in SIZES.items():
            page.set_viewport_size({"width": size[0], "height": size[1]})
            page.wait_for_timeout(300)
            page.screenshot(path=f"{base}-{role}-{name}.png")
        session = page.context.new_cdp_session(page)
        session.send("Emulation.setEmulatedVisionDeficiency", {"type": "protanopia"})
        page.set_viewport_size({"width": 1366, "height": 768})
        page.wait_for_timeout(300)
        page.screenshot(path=f"{base}-{role}-1366-protanope.png")


def _in_scene(browser: Browser, url: str) -> Page:
    page = _opened(browser, url + "&scene=on", *SIZES["1366"])
    page.wait_for_function(
        "[...document.querySelectorAll('#root canvas')].some((one) => one.width > 0)", polling=200
    )
    page.evaluate(SHADOWS)
    page.wait_for_timeout(12000)
    return page


def _scene(browser: Browser, urls: dict[str, str], base: Path) -> None:
    page = _in_scene(browser, urls["operator"])
    page.screenshot(path=f"{base}-3d-before.png", timeout=120000)
    _drive(page, 8000)
    page.screenshot(path=f"{base}-3d.png", timeout=120000)
    page.keyboard.up(PEDAL)
    for inset in INSETS:
        page.evaluate(f"document.querySelector('[data-inset={inset}]').click()")
        page.wait_for_timeout(15000)
        page.screenshot(path=f"{base}-3d-{inset}.png", timeout=120000)


def _fault(browser: Browser, urls: dict[str, str], base: Path) -> None:
    page = _in_scene(browser, urls["operator"])
    instructor = _opened(browser, urls["instructor"] + "&scene=off", *SIZES["1366"])
    page.bring_to_front()
    page.keyboard.down(PEDAL)
    while not page.inner_text("#pedal-state").startswith(
        "down, d"
    ):  # the page was silent in the background
        page.keyboard.up(PEDAL)
        page.wait_for_timeout(DOWN_MS)
        page.keyboard.down(PEDAL)
        page.wait_for_timeout(3 * DOWN_MS)
    instructor.evaluate("document.querySelector('#hazards li:first-child button').click()")
    off = f"parseFloat(document.querySelector('#error-now').textContent) > {FAULT_MM}"
    page.wait_for_function(off, timeout=20000, polling=50)
    with tempfile.TemporaryDirectory() as place:
        page.screenshot(path=f"{place}/page.png", timeout=120000)
        Image.open(f"{place}/page.png").convert("RGB").save(
            base.parent / "training.webp", quality=80
        )


def _drive(page: Page, wait_ms: int) -> None:
    """Press the pedal, move down a little, and keep the pedal pressed."""
    page.keyboard.down(PEDAL)
    page.wait_for_timeout(wait_ms - DOWN_MS)
    page.keyboard.down(DOWN)
    page.wait_for_timeout(DOWN_MS)
    page.keyboard.up(DOWN)


def _opened(browser: Browser, url: str, width: int, height: int) -> Page:
    page = browser.new_context(viewport={"width": width, "height": height}).new_page()
    page.on("console", lambda message: print(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: print(error))
    page.goto(url)
    page.wait_for_function("window.ravenjax?.state?.().frames > 3", polling=100, timeout=60000)
    return page


if __name__ == "__main__":
    main()
