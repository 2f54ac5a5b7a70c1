"""One writer a folder: the second is told who the first is; a lock dies with its process."""

import json
import os
import re
import signal
import socket
import subprocess
import sys

import pytest

from ravenjax.errors import StoreError
from ravenjax.store.access import lock

HOLD = """
import sys, time, pathlib
from ravenjax.store.access import lock
with lock.hold_lock(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()


def test_the_second_is_told_who_holds_it_and_since_when(tmp_path, holder):
    before = (tmp_path / ".lock").read_bytes()
    who = f"process {holder.pid} on {socket.gethostname()}, started {json.loads(before)['since']},"
    with (
        pytest.raises(StoreError, match=re.escape(f"{tmp_path}: {who} is writing into")),
        lock.hold_lock(tmp_path),
    ):
        pytest.fail("held twice")
    assert (tmp_path / ".lock").read_bytes() == before


def test_the_lock_of_a_killed_process_does_not_block(tmp_path, holder):
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert json.loads((tmp_path / ".lock").read_text())["pid"] == holder.pid, (
        "what it wrote is still there"
    )
    with lock.hold_lock(tmp_path):
        assert json.loads((tmp_path / ".lock").read_text())["pid"] == os.getpid()
    assert (tmp_path / ".lock").read_text() == ""
