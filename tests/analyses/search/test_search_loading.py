"""Search files: what they may say, and what is told of those that say something else."""

import tomllib

import pytest

from ravenjax.analyses.search.file import loading
from ravenjax.analyses.search.file.template import Template
from ravenjax.errors import UserError

FILE = """
[campaign]
name = "search"
duration_s = 0.7

[operator]
motion = "reach"

[search]
kind = "boundary"
harm = "peak_golden_deviation_mm >= 1"
signs = [1, -1]

[[group]]
name = "dac"
[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow"]
effect = "offset"
value = { loguniform = [100, 30000] }
start_ms = 300
duration_ms = [4, 8]
"""


def written(tmp_path, old="", new=""):
    assert not old or old in FILE
    path = tmp_path / "search.toml"
    path.write_text(FILE.replace(old, new) if old else FILE)
    return path


def refused(path, *overrides):
    with pytest.raises(UserError) as told:
        loading.load_search(path, overrides)
    return str(told.value)


def test_a_file_loads_and_overrides_reach_both_parts(tmp_path):
    path = written(tmp_path)
    changes = ["search.tolerance=0.1", "campaign.seed=7", "group.dac.fault.0.start_ms=310"]
    config = loading.load_search(path, changes)
    assert config.source == path and config.search.tolerance == 0.1
    assert config.campaign.campaign.seed == 7
    template = Template(config.campaign)
    assert template.cases == 4 and template.labels == ("fault0_value",)
    assert template.case(3) == {"fault0_channel": "elbow", "fault0_duration_ms": 8}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("_mm >= 1", "_mm", "search.harm: got 'peak_golden_deviation_mm', which is a number"),
        ("loguniform = [100,", "uniform = [-100,", "search.signs: the sign -1 requires"),
        ("[[group]]", '[[group]]\nname = "free"\n[[group]]', "got 2 groups, expected one"),
    ],
)
def test_errors_name_line_key_and_what_was_expected(tmp_path, old, new, told):
    assert told in refused(written(tmp_path, old, new))


@pytest.mark.parametrize(
    ("search", "told"),
    [
        ({"kind": "sobol", "outcomes": ["jump_code"], "n": 100}, "such as 64 or 128"),
        ({"kind": "morris", "outcomes": ["jump_code"], "levels": 5}, "such as 6"),
        ({"kind": "sobol", "outcomes": []}, "expected a list of at least 1"),
        ({"kind": "sobol", "outcomes": ["jump_code"]}, "at least 2 distribution"),
        ({"kind": "rare", "event": "jump_code"}, "the search uses the distance from the limit"),
        ({"kind": "rare", "event": "peak_model_deviation_mm >= 3", "runs": 1005}, "such as 1000"),
    ],
)
def test_other_kinds_are_checked(search, told):
    raw = tomllib.loads(FILE) | {"search": search}
    with pytest.raises(UserError, match=told):
        loading.from_dict(raw)
