"""Which folders of fault-free motion count for a campaign, and why the others do not."""

import copy

import pytest
import synthetic_results as synthetic

from ravenjax.store import manifest
from ravenjax.store.access import fault_free
from ravenjax.store.folder import ResultFolder
from ravenjax.store.manifest import CueRecord

CONFIG = {
    "campaign": {"name": "c", "seed": 7, "duration_s": 3.0, "arms": ["gold"], "noise": False},
    "operator": {"motion": "suture", "file": None, "scale": 0.1, "seed": 1},
    "parameters": {"plant.friction_scale": [1.0], "reaction.delay_ms": [100]},
    "haptics": {"threshold_mm": [3.0]},
    "reaction": {"action": "release"},
    "group": [{"name": "dac", "fault": [{"site": "dac"}]}],
}
CAMPAIGN = synthetic.manifest(100, config=CONFIG)


def config(**changes):
    """That of another motion, and what else differs by section."""
    settings = copy.deepcopy(CONFIG) | {"reaction": None, "group": [{"name": "fault_free"}]}
    settings["operator"]["seed"] = 2
    settings["campaign"] |= {"name": "suture_2", "duration_s": 600.0}
    del settings["parameters"]["reaction.delay_ms"]
    for section, keys in changes.items():
        settings[section] |= keys
    return settings


def put(folder, name, **changes):
    """A folder of motion beside the result in `folder`."""
    settings = synthetic.manifest(20, **{"config": config(), **changes})
    results = ResultFolder.open(folder / fault_free.FOLDER / name, settings)
    results.add(synthetic.frame(20))
    return results.path


def test_another_motion_of_the_same_robot_counts_whatever_its_length(tmp_path):
    path = put(tmp_path, "suture_2")
    companions = fault_free.find_fault_free(tmp_path, CAMPAIGN)
    assert [one.path for one in companions.motions] == [path] and companions.excluded == ()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"config": config(operator={"seed": 1})}, "the same motion"),
        (
            {"config": config(operator={"scale": 0.2})},
            "operator.scale: 0.2 here, 0.1 in the campaign",
        ),
        (
            {"config": config(parameters={"plant.friction_scale": [1.4]})},
            "[1.4] here, [1.0] in the campaign",
        ),
        ({"config": config(campaign={"arms": ["green"]})}, 'campaign.arms: ["green"] here'),
        ({"code_hash": "f" * 64}, "computed by another version of the code, ffffffffffffffff"),
        (
            {"cues": synthetic.CUES[:-1] + (CueRecord(threshold_mm=9, kp_per_mm=0.1),)},
            "has other cues",
        ),
        ({"detectors": synthetic.DETECTORS[:1] * 2}, "has other detectors"),
    ],
)
def test_another_robot_or_the_same_motion_does_not_count_and_says_why(tmp_path, changes, why):
    path = put(tmp_path, "motion")
    record = manifest.read_manifest(path)
    manifest.write_manifest(path, record.model_copy(update=changes))
    companions = fault_free.find_fault_free(tmp_path, CAMPAIGN)
    assert companions.motions == () and len(companions.excluded) == 1
    assert companions.excluded[0].startswith("motion: ") and why in companions.excluded[0]
