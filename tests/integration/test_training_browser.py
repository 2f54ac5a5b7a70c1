"""A whole session in a real browser: drive with keys, meet a hazard, feel the cue, lift the
pedal, read the debrief.
"""

import csv
import re
import signal
import subprocess
import sys

import pytest
import waiting
from chromium import CHROMIUM, NEEDED
from foot import hold_pedal

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed (pip install playwright)"
)
pytestmark = [NEEDED, pytest.mark.slow]

HERE = ("http://127.0.0.1", "ws://127.0.0.1", "data:", "blob:")
SCENARIO = """
name = "browser"
title = "In a browser"
arms = ["gold"]
duration_s = 600
seed = 3
scale = 0.1

[task]
kind = "reach"
targets = 300
tolerance_mm = 2.5
dwell_ms = 200

[[hazard]]
name = "creep"
title = "desired shoulder position drifts"
right_response = ["release"]
within_s = 30
[[hazard.fault]]
site = "jpos_d"
channel = "shoulder"
effect = "drift"
value = 5e-5
duration_ms = 20000
"""


@pytest.fixture
def address(tmp_path):
    """Addresses of operator and instructor of a running session, and its folder."""
    scenario, folder = tmp_path / "browser.toml", tmp_path / "session"
    scenario.write_text(SCENARIO)
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "ravenjax.cli",
            "train",
            str(scenario),
            "--out",
            str(folder),
            "--port",
            "0",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    found, said = {}, []
    assert process.stdout is not None
    while len(found) < 3:  # before the loop runs the page answers that it waits
        line = process.stdout.readline()
        assert line, "".join(said)
        said.append(line)
        match = re.match(r"(operator|instructor|realtime): (\S+)", line)
        if match:
            found[match[1]] = match[2]
    yield found["operator"], found["instructor"], folder
    process.send_signal(signal.SIGINT)
    try:
        process.wait(waiting.DEADLINE_S)
    finally:
        process.kill()
        process.stdout.close()


def test_a_session_from_the_first_key_to_the_debrief(address):
    operator_at, instructor_at, folder = address
    asked, told = [], []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )

        def open_page(where):
            page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
            page.set_default_timeout(waiting.DEADLINE_MS)
            page.on("request", lambda request: asked.append(request.url))
            page.on("websocket", lambda socket: asked.append(socket.url))
            page.on(
                "console",
                lambda message: told.append(message.text) if message.type == "error" else None,
            )
            page.on("pageerror", lambda error: told.append(str(error)))
            page.goto(f"{where}&scene=off")
            until(page, "window.ravenjax?.state && window.ravenjax.state().frames > 3")
            return page

        instructor = open_page(instructor_at)
        operator = open_page(operator_at)
        hold_pedal(operator)
        until(operator, "document.querySelector('#runlevel .on').dataset.level === '3'")
        for i in range(6):
            key = "KeyA" if i % 2 else "KeyD"
            operator.keyboard.down(key)
            frames_later(operator, 10)
            operator.keyboard.up(key)
            frames_later(operator, 10)
        until(operator, "ravenjax.latency().count > 0")
        latency = operator.evaluate("ravenjax.latency()")
        assert 0 < latency["mark"] <= latency["mark_drawn"]
        print(
            "key to "
            + ", ".join(f"{name} {latency[name]:.0f} ms" for name in ("mark_drawn", "tip_drawn"))
        )

        hold_pedal(operator)  # still, however busy the machine was
        instructor.evaluate("document.querySelector('#hazards li button.arm').click()")
        until(instructor, "document.querySelector('#hazards li.struck')")
        until(operator, "ravenjax.state().strength > 0")  # the cue, as the hand feels it
        operator.keyboard.up("Space")
        until(
            instructor,
            "[...document.querySelectorAll('#log li')].some((li) =>"
            " li.textContent.includes('release'))",
        )
        assert "hazard" not in operator.inner_text("body").lower()

        for _ in range(2):  # the end is asked twice
            instructor.evaluate("document.querySelector('[data-instructor=end]').click()")
        until(operator, "!document.getElementById('debrief').hidden")
        operator.frame_locator("#debrief iframe").locator("h1, h2").first.wait_for()
        browser.close()
    assert len(asked) > 10 and [url for url in asked if not url.startswith(HERE)] == []
    assert told == []
    waiting.until((folder / "hazards.csv").exists)
    (row,) = csv.DictReader((folder / "hazards.csv").open(encoding="utf-8"))
    assert (
        row["response"] == "release" and row["response_ok"] == "True" and int(row["struck_ms"]) > 0
    )


def until(page, expression):
    page.wait_for_function(expression, polling=50)


def frames_later(page, count):
    """Until so many more frames have come: time as the session has it, however busy the machine
    is.
    """
    until(page, f"ravenjax.state().frames > {page.evaluate('ravenjax.state().frames') + count}")
