"""From a campaign to a set of checks that keeps its promise, and what cannot be asked."""

import json
import re
import xml.etree.ElementTree as ElementTree

import pandas as pd
import pytest

import ravenjax as rj
from ravenjax import cli
from ravenjax.analyses.monitors.counterfactual import finding, output
from ravenjax.analyses.monitors.counterfactual.candidates import Question
from ravenjax.errors import UserError


def tables(**changes):
    """A campaign of faults behind the checks, and one kind that no check misses to see."""
    fault = {
        "site": "usb_out",
        "channel": ["shoulder", "elbow", "insertion"],
        "effect": "overwrite",
        "value": {"uniform": [-20000, 20000]},
        "start_ms": {"uniform": [600, 900]},
        "duration_ms": [16, 64],
    }
    return {
        "campaign": {"name": "small", "duration_s": 1.2, "seed": 4},
        "operator": {"motion": "suture"},
        "group": [
            {"name": "boards", "design": "random", "runs": 160, "fault": [fault]},
            {
                "name": "pulse",
                "fault": [fault | {"value": [0, 1], "start_ms": 700, "duration_ms": 1}],
            },
        ],
    } | changes


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        (
            {"false_alarms_per_hour": 0.0},
            "--false-alarms-per-hour is 0.0, expected a number above 0",
        ),
        (
            {"false_alarms_per_hour": 200.0},
            "--false-alarms-per-hour 200 is one alarm in 18 s. A run of 60 s counts only one",
        ),
        ({"lead_ms": -1}, "--lead-ms is -1, expected a whole number, 0 or more"),
        ({"groups": ("bords",)}, "unknown --group 'bords', expected one of boards, pulse"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_anything_runs(changes, complaint):
    with pytest.raises(UserError, match=re.escape(complaint)):
        finding.find_checks(rj.load_campaign(tables()), Question()._replace(**changes))


@pytest.mark.slow
def test_the_set_as_real_detectors_keeps_its_promise(tmp_path):
    one = finding.find_checks(rj.load_campaign(tables()), Question(hours=0.05, lead_ms=5))
    paths = output.write_files(one, tmp_path)
    both = one.selected_set.selection_coverage.k + one.selected_set.test_coverage.k
    # The same faults: what was computed offline happens, to the run.
    same = finding.confirm_checks(one, paths[-1], seed=4)
    assert (same.all_faults.k, same.all_faults.n) == (both, one.evidence.faults.count)
    other = finding.confirm_checks(one, paths[-1], seed=5)
    assert other.verdict == "as"
    assert other.drawn_faults.n > 20 and other.drawn_faults == other.all_faults
    assert other.test_half == one.selected_set.test_coverage
    assert one.selected_set.test_coverage.value > one.best_single_set.test_coverage.value - 1e-9
    best = max(single.selection_coverage.k for single in one.single_sets)
    assert one.full_set.selection_coverage.k >= best - 2

    table = pd.read_csv(tmp_path / output.TABLE)
    assert len(table) == len(one.candidates) and table["chosen"].sum() == len(
        one.selected_set.indices
    )
    assert set(table["kind"]) == {"bound", "rate", "residual"}
    ElementTree.parse(tmp_path / output.FIGURE)
    said = " ".join(output.finding_sentences(one))
    assert f"{one.selected_set.test_coverage.k} of {one.selected_set.test_coverage.n} (" in said


@pytest.mark.slow
def test_the_command_on_a_result_folder_and_from_python(tmp_path, capsys):
    folder = tmp_path / "small"
    config = tables(campaign={"name": "small", "duration_s": 1.2, "seed": 4, "noise": True})
    config["parameters"] = {"plant.friction_scale": {"uniform": [0.8, 1.2]}}  # robots are drawn
    rj.run(config, folder)
    options = ["--hours", "0.05", "--false-alarms-per-hour", "40", "--most", "1", "--json"]
    assert cli.main(["counterfactual", str(folder), *options, "--out", str(tmp_path)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["checks"]) == 1 and len(told["files"]) == 4
    table = rj.counterfactual(folder, hours=0.05, false_alarms_per_hour=40.0, most=1)
    assert list(table.loc[table["chosen"], "candidate"]) == [told["checks"][0]["candidate"]]
    assert table.attrs["sentences"] == told["sentences"] and table.attrs["files"] == []
    assert (table["false_alarms_hours"] > 0).all()
