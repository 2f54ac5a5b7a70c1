"""Measures a training session that is driven from a browser for some minutes: start time, timing of
the ticks, speed of the page, and memory.

    python analysis/training/session.py [--minutes 10] [--contact | --without-contact]

Starts `ravenjax train`, opens the operator's page in Chromium without the 3D scene, holds the pedal
down and moves the arm back and forth. Twice a minute it prints proportional resident memory (PSS,
MiB) of each process of the session, and at the end the growth from the second minute on. Then it
prints one line of JSON: seconds from the shell to the page's first answer and to the robot, frames
per second, milliseconds from a key to the hand's mark and to the tip (medians), and the session's
record of its ticks. --contact and --without-contact drive the scenario `touch`, with and without
forces of contact.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

EVERY_S = 30.0
SETTLED_S = 60.0


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--contact", action="store_true")
    parser.add_argument("--without-contact", action="store_true")
    given = parser.parse_args()
    scenario = ["first_steps", "--set", "task.targets=1000"]
    if given.contact or given.without_contact:
        scenario = ["touch", "--set", f"contact.on={str(given.contact).lower()}"]
    with tempfile.TemporaryDirectory() as place:
        command = [
            sys.executable,
            "-m",
            "ravenjax.cli",
            "train",
            *scenario,
            "--out",
            f"{place}/session",
            "--port",
            "0",
        ]
        command += ["--linger", "0", "--set", f"duration_s={60 * given.minutes + 30:g}"]
        began = time.monotonic()
        # Python keeps its bytecode, as it does for users.
        kept = os.environ | {"PYTHONDONTWRITEBYTECODE": ""}
        session = subprocess.Popen(command, env=kept, stdout=subprocess.PIPE, text=True)
        try:
            told = _drive(session, given.minutes * 60, began)
        finally:
            session.send_signal(signal.SIGINT)
            session.communicate(timeout=60)
        header = json.loads(Path(f"{place}/session/session.json").read_text())
        load = [round(one, 1) for one in os.getloadavg()]
        print(
            json.dumps(
                {**told, "loop": header["summary"]["timing"], "cpus": os.cpu_count(), "load": load}
            )
        )


def _drive(session: subprocess.Popen[str], seconds: float, started: float) -> dict[str, Any]:
    assert session.stdout is not None
    url = next(
        line.split(": ", 1)[1].strip() for line in session.stdout if line.startswith("operator: ")
    )
    # The first answer may be a page that asks to wait.
    urllib.request.urlopen(url).close()
    told: dict[str, Any] = {"answer_s": round(time.monotonic() - started, 2)}
    next(line for line in session.stdout if line.startswith("realtime: "))
    told["start_s"] = round(time.monotonic() - started, 2)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1366, "height": 768})
        page.goto(f"{url}&scene=off")
        page.wait_for_function("window.ravenjax?.state?.().frames > 3")
        page.wait_for_timeout(2000)
        page.keyboard.down("Space")
        page.evaluate(
            "{ window.pictures = 0; const one = () => { pictures += 1; requestAnimationFrame(one);"
            " }; one(); }"
        )
        began, rows = time.monotonic(), []
        print("| s | " + " | ".join(_memory(session.pid)) + " | all |")
        while (passed := time.monotonic() - began) < seconds:
            if not rows or passed >= rows[-1][0] + EVERY_S:
                found = _memory(session.pid)
                rows.append((passed, *found.values(), sum(found.values())))
                print("| " + " | ".join(f"{x:.1f}" for x in rows[-1]) + " |", flush=True)
            _to_and_fro(page)
        settled = np.array([row for row in rows if row[0] >= SETTLED_S])
        if len(settled) > 2:
            slopes = [np.polyfit(settled[:, 0] / 60, column, 1)[0] for column in settled.T[1:]]
            print("MiB/min: " + ", ".join(f"{slope:.2f}" for slope in slopes))
        told["pictures_per_s"] = round(page.evaluate("pictures") / (time.monotonic() - began), 1)
        told["latency_ms"] = page.evaluate(
            "(({ samples, ...medians }) => medians)(ravenjax.latency())"
        )
        told["pedal"] = page.inner_text("#pedal-state")
        browser.close()
    return told


def _to_and_fro(page: Page) -> None:
    for key in ("KeyD", "KeyA"):
        page.keyboard.down(key)
        page.wait_for_timeout(400)
        page.keyboard.up(key)
        page.wait_for_timeout(100)


def _memory(process: int) -> dict[str, float]:
    """Return name and MiB of the process and its descendants, by process number. Shared memory is
    divided among the processes that share it.
    """
    out: dict[str, float] = {}
    for one in (process, *_below(process)):
        try:
            command = Path(f"/proc/{one}/cmdline").read_text().replace("\0", " ")
            if "resource_tracker" in command:
                continue
            lines = Path(f"/proc/{one}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        out[f"{one}"] = next(
            int(line.split()[1]) / 1024 for line in lines if line.startswith("Pss:")
        )
    return out


def _below(process: int) -> list[int]:
    text = Path(f"/proc/{process}/task/{process}/children").read_text()
    children = [int(one) for one in text.split()]
    return [*children, *(deeper for child in children for deeper in _below(child))]


if __name__ == "__main__":
    main()
