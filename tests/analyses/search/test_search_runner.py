"""A search from file to folder: each kind, small."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from ravenjax import resources
from ravenjax.analyses.search import boundary, journal, runner
from ravenjax.analyses.search.file import loading
from ravenjax.errors import UserError
from ravenjax.store import folder
from ravenjax.store.files import json_values

BASE = {
    "campaign": {"name": "small", "duration_s": 0.5, "seed": 3},
    "operator": {"motion": "reach"},
}
FAULT = {"site": "usb_out", "channel": "shoulder", "effect": "offset", "start_ms": 250}


def search(fault, parameters=None, **section):
    group = {"name": "dac", "fault": [FAULT | fault], "parameters": parameters or {}}
    return loading.from_dict(BASE | {"search": section, "group": [group]})


def files(path):
    """The folder's JSON and rows, once its text and figures have been looked at."""
    text = (path / runner.TEXT).read_text()
    for figure in re.findall(r"!\[\w+\]\((\w+\.svg)\)", text):
        assert (path / figure).read_text().startswith("<?xml")
    assert "nan" not in text.replace("Nan", "")
    page = (path / runner.PAGE).read_text()
    assert (
        page.count('<figure class="drawing"')
        == text.count("![")
        == page.count('<svg aria-hidden="true"')
    )
    assert page.count("<caption ") == text.count("\n| ---")
    return (
        json.loads((path / runner.NUMBERS).read_text()),
        pd.read_parquet(path / journal.ROWS),
        text,
    )


BOUNDARY = {
    "fault": {
        "channel": ["shoulder", "elbow"],
        "duration_ms": [1, 8, 32],
        "value": {"loguniform": [500, 30000]},
    },
    "kind": "boundary",
    "harm": "peak_golden_deviation_mm >= 0.5",
    "signs": [1, -1],
    "scan": 5,
    "tolerance": 0.05,
}


@pytest.fixture(scope="module")
def bounded(tmp_path_factory):
    out = tmp_path_factory.mktemp("boundary")
    return out, runner.run_search(search(**BOUNDARY), out)


def test_a_boundary_is_verified_by_a_campaign_of_its_two_sides(bounded):
    out, _ = bounded
    record, rows, text = files(out)
    cells = record["result"]["cells"]
    assert len(cells) == 12 and record["kind"] == "boundary" and record["runs"] == len(rows)
    crossed = [cell for cell in cells if cell["state"] == "crossing"]
    assert len(crossed) >= 6
    verified = folder.read_all(out / boundary.FOLDER).set_index("run_id")
    for cell in crossed:
        low, high = verified.loc[cell["harmless_run"]], verified.loc[cell["harmful_run"]]
        assert low["peak_golden_deviation_mm"] < 0.5 <= high["peak_golden_deviation_mm"]
        assert low["fault0_value"] == cell["harmless"] and high["fault0_value"] == cell["harmful"]
        assert low["fault0_channel"] == cell["cell"]["fault0_channel"]
        assert abs(cell["harmful"]) <= 1.05 * abs(cell["harmless"]) + 1
        assert np.sign(cell["harmful"]) == (1 if cell["cell"]["sign"] == "+" else -1)
    assert "run again as an ordinary campaign" in text


def test_the_same_search_may_come_again_and_another_not(bounded):
    out, before = bounded
    rows = (out / journal.ROWS).read_bytes()
    again = runner.run_search(search(**BOUNDARY), out)
    assert json_values(again.record["result"]) == json_values(before.record["result"])
    assert (out / journal.ROWS).read_bytes() == rows
    assert (
        again.record["computed"] == 0
        and again.record["runs"] == before.record["computed"] == before.record["runs"]
    )
    text = (out / runner.TEXT).read_text()
    assert f"- {before.record['runs']} different runs" in text
    with pytest.raises(
        UserError,
        match=r"(?s)contains another search.*config\.search\.tolerance: 0\.05 here, 0\.1 requested",
    ):
        runner.run_search(search(**BOUNDARY | {"tolerance": 0.1}), out)


@pytest.mark.slow
def test_a_searched_parameter_has_the_golden_run_of_its_own_value(tmp_path):
    """Of a fault-free change of the robot nothing is harm that its golden run shares."""
    fault = {"value": 0, "duration_ms": 1}
    weak = {"plant.friction_scale": {"uniform": [0.5, 2.0]}}
    config = search(fault, weak, kind="boundary", harm="peak_golden_deviation_mm >= 0.001", scan=5)
    (cell,) = runner.run_search(config, tmp_path).record["result"]["cells"]
    assert cell["state"] == "never"


@pytest.mark.slow
def test_sobol_finds_what_decides(tmp_path):
    fault = {"value": {"uniform": [1000, 20000]}, "duration_ms": {"uniform": [1, 30]}}
    outcomes = ["peak_golden_deviation_mm", "peak_golden_deviation_mm >= 1", "response = stopped"]
    config = search(
        fault,
        {"plant.mass_scale": {"uniform": [0.99, 1.01]}},
        kind="sobol",
        n=32,
        outcomes=outcomes,
    )
    runner.run_search(config, tmp_path)
    record, rows, text = files(tmp_path)
    assert record["result"]["points"] == 32 * 5 and len(rows) <= 160
    assert [one["name"] for one in record["result"]["inputs"]] == [
        "fault0_value",
        "fault0_duration_ms",
        "plant.mass_scale",
    ]
    total = record["result"]["results"][0]["indices"]["ST"]
    value, duration, mass = total["value"]
    assert min(value, duration) > 0.1 and mass < 0.05
    assert all(low <= high for low, high in zip(total["low"], total["high"], strict=True))
    assert "the most important inputs" in text


@pytest.mark.slow
def test_morris_ranks_each_case(tmp_path):
    fault = {
        "channel": ["shoulder", "insertion"],
        "value": {"uniform": [1000, 20000]},
        "duration_ms": {"uniform": [1, 30]},
    }
    config = search(
        fault,
        {"plant.mass_scale": {"uniform": [0.99, 1.01]}},
        kind="morris",
        trajectories=6,
        outcomes=["peak_golden_deviation_mm"],
    )
    runner.run_search(config, tmp_path)
    record, _, _ = files(tmp_path)
    results = record["result"]["results"]
    assert [one["case"]["fault0_channel"] for one in results] == ["shoulder", "insertion"]
    for one in results:
        value, duration, mass = one["indices"]["mu_star"]["value"]
        assert min(value, duration) > 10 * mass


@pytest.mark.slow
def test_a_rare_event_agrees_with_plain_monte_carlo(tmp_path):
    fault = {"value": {"normal": [0, 4000]}, "duration_ms": {"uniform": [1, 20]}}
    config = search(fault, kind="rare", event="peak_golden_deviation_mm >= 1", runs=300, check=1500)
    runner.run_search(config, tmp_path)
    record, rows, text = files(tmp_path)
    (found,) = record["result"]["results"]
    assert 0 < found["monte_carlo"]["probability"] < 0.2 and found["consistent"]
    met = rows["peak_golden_deviation_mm"] >= 1
    assert met.sum() >= round(found["monte_carlo"]["probability"] * 1500)
    assert [level["probability"] for level in found["reached"]][-1] == found["subset"][
        "probability"
    ]
    assert "both agree" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", resources.list_resources(loading.FOLDER, "*.toml"), ids=lambda path: path.stem
)
def test_bundled_searches_run(path, tmp_path):
    record, rows, _ = (runner.run_search(path, tmp_path), *files(tmp_path)[1:])
    assert record.record["runs"] == len(rows)
    assert (rows["failed"] == "").all()
