"""JSON Schemas of the files that people write: every bundled file is valid, and what an editor
should mark is not.
"""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from ravenjax import resources
from ravenjax.analyses.search.file import config as searches
from ravenjax.campaign.inspection import json_schema as campaigns
from ravenjax.cli import main
from ravenjax.robots.raven2 import ROBOT
from ravenjax.train.scenario import loading as scenarios

FOLDERS = {
    "campaign": "campaigns",
    "search": "campaigns/searches",
    "scenario": "campaigns/training",
}
SCHEMAS = {
    "campaign": campaigns.campaign_schema(ROBOT),
    "search": searches.json_schema_of(ROBOT),
    "scenario": scenarios.json_schema(),
}
FILES = [
    (kind, path)
    for kind, folder in FOLDERS.items()
    for path in resources.list_resources(folder, "*.toml")
]

CAMPAIGN = """
[campaign]
name = "x"
[[group]]
name = "g"
[[group.fault]]
site = "usb_out"
effect = "overwrite"
value = { uniform = [-1, 1] }
start_ms = 3
"""
SEARCH = (
    CAMPAIGN
    + """
[search]
kind = "boundary"
harm = "evades"
"""
)
SCENARIO = """
name = "x"
[task]
kind = "reach"
[[hazard]]
hazards = ["B27"]
"""


def problems(kind: str, text: str) -> list[str]:
    return [
        error.message
        for error in jsonschema.Draft202012Validator(SCHEMAS[kind]).iter_errors(tomllib.loads(text))
    ]


@pytest.mark.parametrize(
    ("kind", "path"), FILES, ids=lambda value: value.stem if isinstance(value, Path) else value
)
def test_every_bundled_file_is_valid(kind, path):
    assert problems(kind, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("kind", "right", "wrong"),
    [
        ("campaign", 'name = "x"', 'name = "a b"'),
        ("campaign", 'site = "usb_out"', 'site = "usb_outt"'),
        ("campaign", "uniform", "unifrom"),
        ("campaign", "start_ms = 3", "start_ms = -3"),
        ("campaign", "start_ms = 3", "start_ms = 3\n[parameters]\nplant.frictoin_scale = 2"),
        ("campaign", "start_ms = 3", "start_ms = 3\n[limits]\nelbow_deg = [40, 100]"),
        ("search", 'harm = "evades"', ""),
        ("scenario", '"reach"', '"reech"'),
        (
            "scenario",
            '["B27"]',
            '["B27"]\n[[hazard.fault]]\nsite = "usb_out"\neffect = "overwrite"',
        ),
    ],
)
def test_what_an_editor_marks(kind, right, wrong):
    text = {"campaign": CAMPAIGN, "search": SEARCH, "scenario": SCENARIO}[kind]
    assert right in text and problems(kind, text) == []
    assert problems(kind, text.replace(right, wrong, 1))


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_command_prints_and_writes_it(kind, tmp_path, capsys):
    assert main(["schema", kind]) == 0
    assert json.loads(capsys.readouterr().out) == SCHEMAS[kind]
    assert main(["schema", kind, "--out", str(tmp_path / "schema.json")]) == 0
    assert json.loads((tmp_path / "schema.json").read_text(encoding="utf-8")) == SCHEMAS[kind]
