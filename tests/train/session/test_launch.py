"""Whole sessions: the folder that one leaves, headless and against the clock, and what is asked
before one starts.
"""

import csv
import dataclasses
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
import waiting
from websockets.sync.client import connect

from ravenjax.errors import UserError
from ravenjax.train import launch, scenario
from ravenjax.train.launch import SessionOptions
from ravenjax.train.recording import reader

FAULT = {"site": "usb_out", "channel": "shoulder", "effect": "overwrite", "value": 6000}
HAZARD = {
    "when": [1.5, 1.5],
    "within_s": 1.0,
    "right_response": ["release"],
    "fault": [FAULT | {"start_ms": 0, "duration_ms": 40}],
}
CHOSEN = scenario.from_dict(
    {"name": "tiny", "duration_s": 4, "task": {"kind": "reach", "targets": 50}, "hazard": [HAZARD]}
)


def options(folder, **more):
    return SessionOptions(
        scenario=CHOSEN,
        folder=folder,
        seed=3,
        participant="P7",
        group="A",
        script="release",
        **more,
    )


@pytest.fixture(scope="module")
def headless(tmp_path_factory):
    return launch.run_headless(options(tmp_path_factory.mktemp("sessions") / "one"))


@pytest.mark.slow
def test_a_session_leaves_a_folder_that_says_everything(headless):
    header = json.loads((headless.folder / "session.json").read_text())
    assert header["participant"] == "P7" and header["scenario"]["name"] == "tiny"
    assert header["ended"]
    assert header["summary"]["ended"] == "time" and header["summary"]["hazards"]["struck"] == 1
    with open(headless.folder / "hazards.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["session"] == "one" and row["group"] == "A" and row["response"] == "release"
    read = reader.read_recording(headless.folder)
    (started,) = [event for event in read.events if event["kind"] == "started"]
    # Its four seconds begin as somebody drives.
    assert started["by"] == "pedal" and 200 < started["tick"] < 220
    assert (
        read.complete
        and len(read.rows) < started["tick"] + 4000  # waiting has a row a second
        and read["tick"][-1] == read.numbers[-1] == started["tick"] + 3999
    )
    assert read["left_ms"][0] == 4000 and read["left_ms"][-2] == 2
    assert {event["kind"] for event in read.events} >= {"hazard_struck", "cue", "response", "end"}
    assert "<html" in (headless.folder / "debrief.html").read_text()


@pytest.mark.slow
def test_the_same_commands_again_have_the_same_bits(headless, tmp_path):
    script = str(headless.folder / "commands.jsonl")
    again = launch.run_headless(dataclasses.replace(options(tmp_path / "one"), script=script))
    np.testing.assert_array_equal(
        reader.read_recording(again.folder).rows, reader.read_recording(headless.folder).rows
    )
    assert (again.folder / "hazards.csv").read_bytes() == (
        headless.folder / "hazards.csv"
    ).read_bytes()


@pytest.mark.slow
def test_against_the_clock_it_is_the_same_session_but_for_the_timing(headless, tmp_path):
    found = launch.run_realtime(options(tmp_path / "one"), with_page=False, say=lambda _: None)
    assert found.hazards == headless.hazards and found.ended == "time"
    real, plain = reader.read_recording(found.folder), reader.read_recording(headless.folder)
    assert real.complete and len(real.rows) >= len(plain.rows)
    timing = [
        plain.layout.places[name].start for name in ("compute_us", "lateness_us", "late_ticks")
    ]
    untimed = np.delete(np.arange(plain.layout.size), timing)
    np.testing.assert_array_equal(real.rows[: len(plain.rows), untimed], plain.rows[:, untimed])
    assert (
        json.loads((found.folder / "session.json").read_text())["summary"]["timing"]["ticks"] > 4000
    )


def test_somebody_must_drive_a_headless_session(tmp_path):
    with pytest.raises(UserError, match="commands or one of none, release"):
        launch.run_headless(SessionOptions(scenario=CHOSEN, folder=tmp_path / "x", seed=0))
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    "how", [launch.run_headless, lambda one: launch.run_realtime(one, with_page=False)]
)
def test_a_script_that_is_none_leaves_no_session(tmp_path, how):
    script = tmp_path / "commands.jsonl"
    script.write_text("release\n")
    with pytest.raises(UserError, match=r"commands\.jsonl"):
        how(dataclasses.replace(options(tmp_path / "x"), script=str(script)))
    assert not list(tmp_path.glob("x*/*")) and not list(tmp_path.glob("x*/.*"))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"host": "203.0.113.1"}, r"host is '203\.0\.113\.1', port 0, where the page"),
        ({"port": 65536}, "port 65536, where the page cannot listen"),
    ],
)
def test_an_address_where_no_page_can_be_is_refused_at_once(tmp_path, wrong, told):
    with pytest.raises(UserError, match=told):
        launch.run_realtime(options(tmp_path / "x", **wrong))
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
def test_a_second_session_begins_without_jax_and_trimesh(tmp_path):
    code = """if True:
        import sys
        from pathlib import Path
        from ravenjax.train import launch, scenario
        from ravenjax.train.page import process
        setting = scenario.load_scenario("first_steps", ["duration_s=5"])
        folder = Path(sys.argv[1])
        launch.run_headless(
            launch.SessionOptions(scenario=setting, folder=folder, seed=0, script="release")
        )
        print([name for name in ("jax", "trimesh") if name in sys.modules])
    """
    # the first session traces the tick through JAX, and keeps what it traced
    for name in ("first", "second"):
        ran = subprocess.run(
            [sys.executable, "-c", code, tmp_path / name],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "RAVENJAX_CACHE": str(tmp_path / "cache")},
        )
    assert ran.stdout.strip() == "[]"


def test_a_folder_that_is_there_is_left_alone(tmp_path):
    lines, folder = [], tmp_path / "x"
    first, second = (launch._with_new_folder(options(folder), lines.append) for _ in range(2))
    assert (first.folder, second.folder) == (folder, tmp_path / "x-2")
    assert len(lines) == 1 and f"the session is written to {tmp_path / 'x-2'}" in lines[0]
    (folder / "file").touch()
    with pytest.raises(UserError, match="cannot be created"):
        launch._with_new_folder(options(folder / "file" / "y"), lines.append)


def started(folder, *options, port=0):
    """`ravenjax train first_steps` as a process; its output line by line."""
    command = ["train", "first_steps", "--out", folder, "--port", port, *options]
    return subprocess.Popen(
        [sys.executable, "-m", "ravenjax.cli", *map(str, command)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )


@pytest.mark.slow
def test_sigterm_before_it_begins_ends_it_without_a_traceback(tmp_path):
    ran, said = started(tmp_path / "x"), ""
    for line in ran.stdout:
        said += line
        if "robot: ready" in line:
            ran.terminate()
    assert ran.wait(60) == 128 + signal.SIGTERM
    assert "if a session began, its recording is kept" in said
    assert "Traceback" not in said


@pytest.mark.slow
@pytest.mark.parametrize("when", ["preparing the session", "operator:", "realtime:"])
def test_one_interruption_ends_it_whenever_it_comes(tmp_path, when):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ran, said = started(tmp_path / "x", port=port), ""
        # An interruption that is lost ends nothing.
        late = threading.Timer(waiting.DEADLINE_S, ran.kill)
        late.start()
        for line in ran.stdout:
            said += line
            if when in line:
                time.sleep(0.3)
                os.killpg(ran.pid, signal.SIGINT)  # as a terminal does: every process of the group
        late.cancel()
        # By the signal: Python ends so where it came while a dataclass was being made.
        assert ran.wait(60) in (0, 130, -signal.SIGINT) and "Traceback" not in said
    if when != "preparing the session":
        assert f"port {port} is in use: the page is at port" in said
    if when == "realtime:":
        assert (tmp_path / "x" / "debrief.html").exists() and "(interrupted)" in said


@pytest.mark.slow
def test_the_instructor_starts_the_next_session_from_the_browser(tmp_path):
    """The second takes the first's port and tokens; strangers get neither it nor the list."""
    ran = started(tmp_path / "one", "--instructor-token", "chair")
    said, ports = "", []
    try:
        for line in ran.stdout:
            said += line
            if line.startswith("operator: "):
                ports.append(int(line.split(":")[3].split("/")[0]))
                early = urllib.request.urlopen(line.removeprefix("operator: ")).read()
                assert b"is being prepared" in early
            if line.startswith("realtime: ") and len(ports) == 1:
                say(ports[0], {"type": "instructor", "do": "end"})
            if "the page stays" in line and len(ports) == 1:
                with pytest.raises(urllib.error.HTTPError, match="403"):
                    urllib.request.urlopen(f"http://127.0.0.1:{ports[0]}/sessions")
                base, key = f"http://127.0.0.1:{ports[0]}", "?instructor_token=chair"
                text = urllib.request.urlopen(f"{base}/sessions{key}").read().decode()
                debrief = f"/sessions/one/debrief.html{key}"
                assert "first_steps" in text and debrief in text
                page_of_it = urllib.request.urlopen(base + debrief).read()
                assert b"ravenjax training session" in page_of_it
                say(ports[0], {"type": "instructor", "do": "next", "participant": "P9", "seed": 4})
            if line.startswith("realtime: ") and len(ports) == 2:
                assert say(ports[1], {"type": "instructor", "do": "end"})["participant"] == "P9"
                time.sleep(2.0)
                os.killpg(ran.pid, signal.SIGINT)
        assert ran.wait(60) == 0 and ports[0] == ports[1], said
    finally:
        ran.kill()
    finished = [one.name for one in tmp_path.iterdir() if (one / "debrief.html").exists()]
    assert sum("P9" in name for name in finished) == 1


def say(port, command):
    """Say it as the instructor; the header that the instructor's window is greeted with."""
    with connect(f"ws://127.0.0.1:{port}/session?role=instructor&instructor_token=chair") as socket:
        greeting = json.loads(socket.recv())
        socket.send(json.dumps(command))
        time.sleep(0.3)
    return greeting["header"]
