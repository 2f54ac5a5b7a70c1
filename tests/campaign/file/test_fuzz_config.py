"""Campaigns with anything wrong anywhere: loading gives a campaign or a UserError, never another
exception.
"""

import copy
import re

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ravenjax.campaign import loading
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError

FULL = {
    "campaign": {
        "name": "full",
        "duration_s": 0.5,
        "arms": ["gold", "green"],
        "tools": ["r_grasper", "large_needle"],
        "software": "raven2",
        "noise": True,
        "seed": 3,
        "limit": 100,
    },
    "operator": {"motion": "suture", "scale": 0.2, "seed": 1},
    "parameters": {
        "plant": {"friction_scale": {"uniform": [0.5, 2.0]}},
        "operator.scale": [0.05, 0.1],
    },
    "limits": {"elbow_deg": [50, 120], "insertion_m": [0.3, 0.5]},
    "haptics": {"threshold_mm": [3, 2], "cap": 0.05, "combine": "grid"},
    "outcomes": {"jump": "text", "cue": 1},
    "group": [
        {
            "name": "lists",
            "repeats": 2,
            "fault": [
                {
                    "site": "usb_out",
                    "arm": "gold",
                    "channel": ["shoulder", "elbow"],
                    "effect": ["overwrite", "latch_offset"],
                    "value": [100, -200.0],
                    "trigger": ["time", "pedal"],
                    "start_ms": [10, 20],
                    "duration_ms": [5, "end"],
                    "wraps": True,
                }
            ],
        },
        {
            "name": "drawn",
            "design": "sobol",
            "runs": 16,
            "parameters": {"plant.gold.mass_scale": {"normal": [1.0, 0.05]}},
            "fault": [
                {
                    "site": "network",
                    "effect": {"choice": ["delay", "drop"]},
                    "value": 3,
                    "start_ms": {"uniform": [10, 300]},
                    "duration_ms": 20,
                    "every_ms": 50,
                }
            ],
        },
        {
            "name": "listed",
            "design": "list",
            "fault": [{"site": "runlevel", "effect": "overwrite", "value": 1, "start_ms": 50}],
            "run": [
                {"fault": [{"value": 2, "duration_ms": "end"}]},
                {"parameters": {"plant.gold.mass_scale": 1.1}},
            ],
        },
    ],
}
LIMITED = FULL
FULL = {
    **FULL,
    "campaign": {name: value for name, value in FULL["campaign"].items() if name != "limit"},
    "cross": {"reaction": {"action": [0, 1]}, "plant.cable_damping": [400, 500]},
    "reaction": {"action": "slow", "delay_ms": 200, "slow_to": 0.5},
    "detector": [
        {
            "name": "model",
            "kind": "steps",
            "fusion": ["all", "any"],
            "consecutive": [1, 3],
            "threshold": [0.5, 1],
        },
        {"name": "tip", "kind": "tip_error", "threshold": 3},
    ],
    "stop": {
        "half_width": 0.05,
        "rates": ["evades", "cue"],
        "of": "whole",
        "looks": [0.1, 1.0],
        "allocation": "neyman",
    },
    "group": [
        *FULL["group"],
        {"name": "library", "hazards": ["C02", "B25"], "arm": "gold", "start_ms": 100},
    ],
}

JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.sampled_from(
        [
            10**30,
            -(10**400),
            2**31,
            2**63,
            0,
            -1,
            1e308,
            1e-308,
            "end",
            "*",
            "nan",
            "",
            "gold",
            b"x",
            1j,
        ]
    ),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["uniform", "normal", "choice", "loguniform"]).flatmap(
        lambda kind: st.lists(
            st.one_of(st.floats(), st.integers(), st.text(max_size=3)), max_size=3
        ).map(lambda values: {kind: values})
    ),
    st.recursive(
        st.none() | st.integers() | st.text(max_size=3),
        lambda inner: st.lists(inner, max_size=3),
        max_leaves=6,
    ),
    st.recursive(
        st.integers() | st.text(max_size=3),
        lambda inner: st.dictionaries(st.text(max_size=4) | st.integers(), inner, max_size=3),
        max_leaves=6,
    ),
)


def places(tree, at=()):
    """The path of every entry of nested tables and lists."""
    entries = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    for key, value in entries:
        yield (*at, key)
        yield from places(value, (*at, key))


@st.composite
def campaigns(draw, bases):
    """A campaign with one to four things changed."""
    tree = copy.deepcopy(draw(st.sampled_from(bases)))
    for _ in range(draw(st.integers(1, 4))):
        known = list(places(tree))
        if not known:
            break
        *parents, key = draw(st.sampled_from(known))
        table = tree
        for parent in parents:
            table = table[parent]
        change = draw(st.sampled_from(("delete", "rename", "replace", "wrap", "double", "insert")))
        if change == "delete":
            del table[key]
        elif change == "replace":
            table[key] = draw(JUNK)
        elif change == "wrap":
            table[key] = [table[key]]
        elif isinstance(table, list):
            table.append(copy.deepcopy(table[key]))
        elif change == "rename":
            table[draw(st.text(max_size=6))] = table.pop(key)
        else:
            table[draw(st.text(max_size=6))] = draw(JUNK)
    return tree


def loaded(raw, overrides=()):
    """The campaign, or None where it is refused in words."""
    try:
        return loading.from_dict(raw, overrides=overrides)
    except UserError as error:
        assert 0 < len(str(error)) < 20_000
        return None


RELAXED = settings(max_examples=120, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
@RELAXED
@given(campaigns([FULL, LIMITED]))
def test_a_changed_campaign(raw):
    config = loaded(raw)
    if config is not None:
        assert isinstance(config, CampaignConfig)
        assert loading.from_dict(config.model_dump(mode="json")) == config, (
            "the manifest means the same campaign"
        )


@RELAXED
@given(JUNK)
@example({"campaign": {"name": "x"}, "group": [{"name": "g"}], 3: 4})
@example([])
def test_anything_at_all(raw):
    loaded(raw)


TEXT = """
[campaign]
name = "text"
duration_s = 4.0
seed = 3
arms = ["gold", "green"]

[operator]
motion = "suture"
scale = 0.1

[parameters]
plant.friction_scale = { uniform = [0.5, 2.0] }

[cross]
reaction.action = [0, 1]

[limits]
elbow_deg = [50, 120]

[haptics]
threshold_mm = [3, 2]
combine = "grid"

[reaction]
action = "slow"
delay_ms = 200

[[detector]]
name = "model"
kind = "steps"
fusion = ["all", "any"]
threshold = [0.5, 1]

[outcomes]
jump = "text"
cue = 1

[stop]
half_width = 0.05
rates = ["evades", "cue"]
looks = [0.1, 1.0]
allocation = "neyman"

[[group]]
name = "drawn"
design = "sobol"
runs = 16
[[group.fault]]
site = "usb_out"
arm = "gold"
channel = ["shoulder", "elbow"]
effect = ["overwrite", "latch_offset"]
value = { uniform = [-200, 200] }
start_ms = [10, 20]
duration_ms = [5, "end"]

[[group]]
name = "library"
hazards = ["C09", "L7"]
arm = "gold"
start_ms = 100
"""
WRITTEN = [number for number, line in enumerate(TEXT.splitlines()) if " = " in line]
WRONG = (
    "-1",
    "1e9",
    '"nonsense"',
    "[]",
    "[1, 2, 3]",
    '["x"]',
    "{ x = 1 }",
    "{ uniform = [2, 1] }",
    "true",
    '""',
    "nan",
)
SAYS = (
    "expected",
    "exactly one of",
    "missing",
    "unknown key",
    "remove",
    "write",
    "belongs to",
    "needs",
    "give",
    "got",
)
"""Each complaint has at least one of these words: it says what was got, or what to write
instead.
"""


@settings(RELAXED, max_examples=100)
@given(st.sampled_from(WRITTEN), st.sampled_from(WRONG))
@example(WRITTEN[-1], "[]")
def test_a_wrong_value_is_located(tmp_path_factory, number, wrong):
    """One value of a file replaced: a campaign, or complaints that name file, line and key and
    what was expected.
    """
    rows = TEXT.splitlines()
    key = rows[number].partition(" = ")[0]
    rows[number] = f"{key} = {wrong}"
    path = tmp_path_factory.mktemp("c", numbered=True) / "c.toml"
    path.write_text("\n".join(rows))
    try:
        loading.load(path)
    except UserError as error:
        for complaint in str(error).splitlines():
            assert complaint.startswith(f"{path}:") and any(word in complaint for word in SAYS), (
                complaint
            )
            line, named, _ = complaint.removeprefix(f"{path}:").split(": ", 2)
            there = rows[int(line) - 1]
            last = re.sub(r"\[\d+\]", "", named).rpartition(".")[2]
            assert there.startswith("[") or last in there, (
                complaint
            )  # of a key that is missing, the table
