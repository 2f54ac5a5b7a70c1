"""More fault-free motion of a campaign's robot: different, of the same robot, and as much as
asked.
"""

import copy

import pandas as pd
import pytest

import ravenjax as rj
from ravenjax.campaign import plan, runner
from ravenjax.campaign.inspection import fault_free
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.store import folder, manifest
from ravenjax.store.access.fault_free import FOLDER, find_fault_free

HOUR_MS = 3.6e6
CAMPAIGN = {
    "campaign": {"name": "small", "duration_s": 0.6, "seed": 3},
    "operator": {"motion": "reach", "seed": 4},
    "parameters": {"plant.friction_scale": 1.2},
    "haptics": {"threshold_mm": [0.1, 3.0]},
    "reaction": {"action": "release"},
    "group": [
        {
            "name": "dac",
            "fault": [
                {
                    "site": "usb_out",
                    "channel": "elbow",
                    "effect": "overwrite",
                    "value": 9000,
                    "start_ms": 300,
                }
            ],
        }
    ],
}


@pytest.fixture
def short(monkeypatch):
    """Runs of a second or two."""
    monkeypatch.setattr(fault_free, "SHORTEST_S", 1)
    monkeypatch.setattr(fault_free, "LONGEST_S", 2)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A result folder of which nothing is computed yet: its record says all that is needed."""
    path = tmp_path_factory.mktemp("result") / "small"
    path.mkdir()
    ready = plan.make_plan(rj.load_campaign(CAMPAIGN))
    manifest.write_manifest(path, runner.make_manifest(ready, selection.select_engine("simd")))
    return path


@pytest.mark.slow
def test_as_many_hours_as_asked_of_different_motion(result, short):
    told = []
    wanted = 3.0 / 3600  # 3 s in pedal-down, of runs that are so for 1.8 s
    there = fault_free.extend_fault_free(
        result, wanted, on_motion=lambda hours, path: told.append((hours, path.name))
    )
    found = find_fault_free(result, manifest.read_manifest(result))
    tables = [folder.read_all(one.path) for one in found.motions]
    assert [one.path.name for one in found.motions] == [
        "reach_5",
        "reach_6",
    ] and found.excluded == ()
    assert there == pytest.approx(sum(table["pedal_down_ms"].sum() for table in tables) / HOUR_MS)
    assert wanted <= there < wanted + 1.8 / 3600
    assert told == [(0.0, "reach_5"), (pytest.approx(there / 2), "reach_6")]
    rows = pd.concat(tables)
    assert not any(name.startswith("fault") for name in rows)
    assert (rows["failed"] == "").all() and rows["tip_path_mm"].nunique() == len(rows) == 2
    # asked for again there is nothing to do; for more, what is there counts
    assert fault_free.extend_fault_free(result, wanted) == there
    more = fault_free.extend_fault_free(result, there + 1e-6)
    assert more == pytest.approx(1.5 * there) and (result / FOLDER / "reach_7").is_dir()


def changed(result, **sections):
    """The record of a result whose configuration differs."""
    record = manifest.read_manifest(result)
    made = copy.deepcopy(record.config)
    for name, keys in sections.items():
        made[name] |= keys
    return record.model_copy(update={"config": made})


@pytest.mark.parametrize(
    ("operator", "why"),
    [
        ({"motion": "still"}, "'still' is the same motion for every seed"),
        (
            {"motion": None, "file": "/data/hand.csv"},
            r"the operator is a recording \(/data/hand.csv\)",
        ),
    ],
)
def test_an_operator_without_another_motion_is_refused(result, tmp_path, operator, why):
    manifest.write_manifest(tmp_path, changed(result, operator=operator))
    with pytest.raises(UserError, match=why):
        fault_free.extend_fault_free(tmp_path, 1.0)
    with pytest.raises(UserError, match="robot 'arm' has the same motion for every seed"):
        fault_free.require_new_motions({"campaign": {"robot": "arm"}})


def test_a_result_of_another_version_is_refused(result, tmp_path):
    manifest.write_manifest(
        tmp_path, manifest.read_manifest(result).model_copy(update={"code_hash": "0" * 64})
    )
    with pytest.raises(UserError, match="computed by another version of the code"):
        fault_free.extend_fault_free(tmp_path, 1.0)
