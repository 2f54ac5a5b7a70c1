"""Runs whose numbers leave the finite, by parameters within their ranges: class failed, and in
no rate.
"""

import re

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign.inspection.replay import Replayer
from ravenjax.cli import main
from ravenjax.report.run import summary as run_summary
from ravenjax.vocabulary import failures

FAULT = {
    "site": "usb_out",
    "arm": "gold",
    "channel": "elbow",
    "effect": "overwrite",
    "value": 5000.0,
}
CAMPAIGN = {
    "campaign": {"name": "failing", "duration_s": 1.2, "arms": ["gold"]},
    "group": [
        {"name": "sound", "fault": [FAULT | {"start_ms": [700, 701], "duration_ms": 50}]},
        {
            "name": "wild",
            "parameters": {"nominal.ki": 1e6},
            "fault": [FAULT | {"start_ms": [700, 701], "duration_ms": 50}],
        },
    ],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of the campaign, and its table."""
    place = tmp_path_factory.mktemp("failing") / "out"
    return place, rj.run(CAMPAIGN, out=place, engine="simd")


def test_they_say_the_number_and_the_tick_that_first_left_the_finite(folder):
    _, table = folder
    sound, wild = table[table["group"] == "sound"], table[table["group"] == "wild"]
    assert (
        (sound["failed"] == "").all()
        and (sound["failed_first_ms"] == -1).all()
        and (sound["verdict"] != "").all()
    )
    assert (wild["verdict"] == "").all() and set(wild["failed"]) == {
        failures.CAUSES[failures.CODES["model tip"] + 1]
    }
    again = Replayer(rj.load_campaign(CAMPAIGN), "simd").replay(2)
    finite = np.isfinite(again.series["gold/model_position"]).all(axis=1)
    assert wild["failed_first_ms"].iloc[0] == np.flatnonzero(~finite)[0] > 204, (
        "not before the pedal is down"
    )
    words = run_summary.summarize_run(
        again.row.to_dict(), rj.load_campaign(CAMPAIGN).rules, again.series, again.golden
    )
    assert re.search(r"no valid outcome \(model tip not finite at [\d,]+ ms\)", words.verdict)


def test_they_count_in_no_rate_of_the_command_line_and_the_report(folder):
    place, _ = folder
    assert main(["report", str(place)]) == 0
    page = re.sub(
        r"<(script|style).*?</\1>|<[^>]+>",
        " ",
        (place / "report.html").read_text(),
        flags=re.DOTALL,
    )
    words = " ".join(page.split())
    assert "2 of 4 runs gave no valid outcome. Rates do not include these runs." in words
    assert "Of 2 distinct" in words and "model tip not finite" in words
