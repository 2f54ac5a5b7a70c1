"""A campaign that stops by itself, really killed again and again: its table and its decisions
stay the same.
"""

import json
import random
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

from ravenjax.campaign.stop import decisions
from ravenjax.store.folder import read_all

FAULT = {
    "site": "usb_out",
    "channel": "elbow",
    "effect": "overwrite",
    "start_ms": 100,
    "duration_ms": 8,
}
CAMPAIGN = {
    "campaign": {"name": "killed", "duration_s": 2.0, "chunk": 128},
    "stop": {"half_width": 0.04, "looks": [0.05, 0.1, 0.2, 0.4, 1.0], "allocation": "neyman"},
    "group": [
        {"name": "list", "fault": [FAULT | {"value": list(range(-20_000, 20_000, 40))}]},
        {
            "name": "drawn",
            "design": "sobol",
            "runs": 4000,
            "fault": [FAULT | {"value": {"uniform": [0, 30_000]}}],
        },
    ],
}
RUN = f"""
import sys
from pathlib import Path
from ravenjax.campaign import loading
from ravenjax.campaign.stop import adaptive
adaptive.run_adaptively(loading.from_dict({json.dumps(CAMPAIGN)}), Path(sys.argv[1]))
"""


def start(folder):
    return subprocess.Popen([sys.executable, "-c", RUN, str(folder)])


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    begun = time.monotonic()
    assert start(whole).wait(600) == 0
    took, moments = time.monotonic() - begun, random.Random(7)
    killed = 0
    for _ in range(12):
        process = start(cut)
        try:
            process.wait(took * moments.uniform(0.2, 0.8))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            killed += process.wait() == -signal.SIGKILL
    assert start(cut).wait(600) == 0
    assert killed >= 3, "some starts were cut short"
    assert (cut / decisions.FILE).read_bytes() == (whole / decisions.FILE).read_bytes()
    pd.testing.assert_frame_equal(read_all(cut), read_all(whole))
