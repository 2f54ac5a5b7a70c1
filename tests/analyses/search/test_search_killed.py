"""A search, really killed again and again: what it finds and the runs behind it stay the same."""

import json
import random
import signal
import subprocess
import sys
import time

import pytest

from ravenjax.analyses.search import journal, runner
from ravenjax.store import folder, parts

SEARCH = {
    "campaign": {"name": "killed", "duration_s": 3.0, "seed": 3},
    "operator": {"motion": "reach"},
    "search": {
        "kind": "rare",
        "event": "peak_golden_deviation_mm >= 4",
        "runs": 500,
        "check": 8000,
    },
    "group": [
        {
            "name": "dac",
            "fault": [
                {
                    "site": "usb_out",
                    "channel": "shoulder",
                    "effect": "latch_offset",
                    "value": {"normal": [0, 1000]},
                    "start_ms": {"uniform": [500, 900]},
                    "duration_ms": {"uniform": [1, 60]},
                }
            ],
        }
    ],
}
RUN = f"""
import sys
from pathlib import Path
from ravenjax.analyses.search import runner
from ravenjax.analyses.search.file import loading
runner.run_search(loading.from_dict({json.dumps(SEARCH)}), Path(sys.argv[1]))
"""
KILLS = 10


def start(out):
    return subprocess.Popen([sys.executable, "-c", RUN, str(out)])


def wait_for_parts(process, out, count):
    """Until so many parts are there, or the process has ended."""
    while process.poll() is None and len(parts.part_files(out / folder.PARTS)) < count:
        time.sleep(0.005)


@pytest.mark.slow
def test_killed_after_each_part(tmp_path):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert start(whole).wait(600) == 0
    moments, killed = random.Random(5), 0
    for _ in range(KILLS):
        process = start(cut)
        wait_for_parts(process, cut, len(parts.part_files(cut / folder.PARTS)) + 1)
        time.sleep(moments.uniform(0.0, 0.3))
        process.send_signal(signal.SIGKILL)
        killed += process.wait() == -signal.SIGKILL
    assert start(cut).wait(600) == 0
    assert killed >= 3, "some starts were cut short"
    found, expected = (json.loads((out / runner.NUMBERS).read_text()) for out in (cut, whole))
    assert (
        found["result"] == expected["result"] and found["result"]["results"][0]["subset"]["levels"]
    )
    assert found["computed"] < expected["computed"] == expected["runs"] == found["runs"]
    assert (cut / journal.ROWS).read_bytes() == (whole / journal.ROWS).read_bytes()
