"""Work in a process of its own: its result comes back, and of whatever else happens there one
line.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from ravenjax.bench import apart
from ravenjax.errors import UserError


def adds(one, other):
    print("this goes to standard error")
    return one + other, os.environ.get("RAVENJAX_CACHE"), os.getpid()


def fails(kind):
    raise kind("a first line\nand a second one")


def crashes():
    os.kill(os.getpid(), signal.SIGSEGV)


def is_ended_for_its_memory():
    os.kill(os.getpid(), signal.SIGKILL)


def leaves():
    os._exit(3)


def returns_what_does_not_travel():
    return lambda: 0


def starts_another_and_sleeps(place):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    with open(place, "w") as file:
        file.write(str(child.pid))
    time.sleep(60)


def test_a_result_comes_back_with_what_it_took(capfd):
    answer = apart.run(adds, 3, 4, limit_s=60.0, environment={"RAVENJAX_CACHE": "off"})
    total, cache, process = answer.value
    assert (total, cache, answer.why) == (7, "off", "") and process != os.getpid()
    assert os.environ.get("RAVENJAX_CACHE") != "off" or "RAVENJAX_CACHE" in os.environ
    assert answer.seconds > 0.0 and 5.0 < answer.peak_mb < 1000.0
    out, err = capfd.readouterr()
    assert out == "" and "standard error" in err


@pytest.mark.parametrize(
    ("work", "arguments", "why"),
    [
        (fails, (ValueError,), "ValueError: a first line and a second one"),
        (fails, (UserError,), "a first line and a second one"),
        (fails, (SystemExit,), "SystemExit: a first line and a second one"),
        (crashes, (), "its process was ended by signal SIGSEGV"),
        (
            is_ended_for_its_memory,
            (),
            "its process was ended by signal SIGKILL, as the system does where memory is short",
        ),
        (leaves, (), "its process ended with code 3 and no answer"),
    ],
)
def test_what_goes_wrong_is_one_line(work, arguments, why):
    answer = apart.run(work, *arguments, limit_s=60.0)
    assert answer.value is None and answer.why == why


def test_a_result_that_does_not_travel_is_told():
    answer = apart.run(returns_what_does_not_travel, limit_s=60.0)
    assert answer.value is None and answer.why


def test_what_does_not_finish_is_ended_with_all_that_it_started(tmp_path):
    place = tmp_path / "pid"
    answer = apart.run(starts_another_and_sleeps, str(place), limit_s=4.0)
    assert answer.why == "not finished within 4 s" and answer.value is None
    assert answer.seconds < 20.0 and not multiprocessing.active_children()
    child = int(place.read_text())
    for _ in range(100):
        if not _runs(child):
            return
        time.sleep(0.05)
    raise AssertionError(f"process {child} still runs")


def _runs(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_long_reasons_are_cut():
    line = apart.one_line(ValueError("x" * 1000))
    assert len(line) == apart.LONGEST_WHY and line.endswith("..")
    assert apart.one_line(ValueError()) == "ValueError"
