"""Campaigns declared in Python are those of TOML files, both ways, with the same errors."""

import copy
import tomllib

import pytest

import ravenjax as rj
from ravenjax import resources
from ravenjax.campaign import loading
from ravenjax.campaign.file.axis import DISTRIBUTIONS, PHASE
from ravenjax.campaign.file.section import toml_value

BUNDLED = resources.list_resources("campaigns", "*.toml")


def again(campaign):
    """What the repr of a campaign evaluates to."""
    return eval(repr(campaign), {"rj": rj})


def plain(config):
    return config.model_dump(mode="json")


@pytest.mark.parametrize("file", BUNDLED, ids=lambda file: file.stem)
def test_a_bundled_campaign_goes_through_python_and_back(file):
    campaign = rj.Campaign.from_toml(file)
    text = campaign.to_toml()
    assert (
        plain(loading.from_dict(tomllib.loads(text)))
        == plain(loading.load_campaign(file))
        == plain(campaign.config)
    )
    assert (
        rj.Campaign.from_toml(text)
        == campaign
        == rj.Campaign(**tomllib.loads(text))
        == again(campaign)
    )
    assert "[campaign]" in text and text.count("[[group]]") == len(
        tomllib.loads(file.read_text())["group"]
    )


def minimal(**more):
    return {"name": "x", "group": [rj.Group(name="a")], **more}


@pytest.mark.parametrize(
    "keys",
    [
        minimal(seed="three"),
        minimal(sed=3),
        minimal(haptic={"cap": 0.1}),
        {"name": "x"},
        minimal(parameters={"plant.mass_scale": {"uniform": [2, 1]}}),
    ],
    ids=lambda keys: str(sorted(keys)),
)
def test_an_error_is_that_of_the_file(keys):
    sections = ("haptics", "haptic", "operator", "group", "parameters")
    raw = {"campaign": {key: value for key, value in keys.items() if key not in sections}}
    raw |= {key: toml_value(value) for key, value in keys.items() if key in sections}
    with pytest.raises(rj.UserError) as of_file:
        loading.from_dict(raw)
    with pytest.raises(rj.UserError) as in_python:
        rj.Campaign(**keys)
    assert str(in_python.value) == str(of_file.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: rj.Fault(site="usb_out", efect="offset", start_ms=1),
            r"Fault\.efect: unknown key, .* Did you mean 'effect'\?",
        ),
        (
            lambda: rj.Group(name="a", fault=[{"site": "hand", "effect": 1, "start_ms": 1}]),
            r"Group\.fault\[0\]\.effect: got 1, expected the name of an effect",
        ),
        (lambda: rj.Haptics(cap=[]), "Haptics.cap: got .*, expected a list of at least 1"),
        (
            lambda: rj.Group(name="a", hazards=["C02"]),
            "in Python, write a group that names hazards as a dict",
        ),
    ],
)
def test_a_table_is_checked_when_it_is_made(make, words):
    with pytest.raises(rj.UserError, match=words):
        make()


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("nothing_like_it", "no such campaign file"),
        ("[campaign\n", "the text: not valid TOML"),
        ("[campaign]\nname = 'x'\n", "group: missing: groups of runs"),
        (5, "expected the path"),
    ],
)
def test_what_is_no_toml(source, words):
    with pytest.raises(rj.UserError, match=words):
        rj.Campaign.from_toml(source)


def test_overrides_are_those_of_the_command_line():
    campaign = rj.Campaign.from_toml("quick", ["campaign.limit=5", "group.hand.fault.0.value=7"])
    assert campaign == rj.Campaign.from_toml(campaign.to_toml())
    assert campaign.config.campaign.limit == 5 and campaign.config.group[2].fault[
        0
    ].value.values == (7,)


def test_a_campaign_is_frozen_and_replaced():
    campaign = rj.Campaign(**minimal(seed=1))
    with pytest.raises(AttributeError, match=r"replace\(seed=\.\.\.\)"):
        campaign.seed = 2
    other = campaign.replace(seed=2, group=[*campaign.config.group, rj.Group(name="b")])
    assert campaign != other and other.config.campaign.seed == 2 and len(other.config.group) == 2
    assert other.replace(seed=None).config.campaign.seed == 0
    assert copy.copy(campaign) == campaign


def test_every_form_of_an_axis_has_a_function():
    assert {*DISTRIBUTIONS, PHASE} < set(rj.__all__)
    assert rj.uniform(1, 2) == {"uniform": [1, 2]} and rj.together((1, 2)) == {"together": [1, 2]}
    assert rj.normal(1, 0.1) == {"normal": [1, 0.1]}
    assert rj.loguniform(1, 9) == {"loguniform": [1, 9]}
    assert rj.phase("fast", (0, 1)) == {"phase": "fast", "share": [0, 1]}


def test_files_are_taken_along(tmp_path, monkeypatch):
    (tmp_path / "checks").mkdir()
    (tmp_path / "checks" / "mine.py").write_text(
        "def step(params, state, view):\n    return state, view.tip_error\n"
    )
    (tmp_path / "robots.toml").write_text("[parameters]\nplant.mass_scale = 1.1\n")
    monkeypatch.chdir(tmp_path)
    campaign = rj.Campaign(
        **minimal(
            detector=[rj.Detector(name="mine", file="checks/mine.py")],
            parameters={"from": "robots.toml"},
        )
    )
    text = campaign.to_toml(tmp_path / "own.toml")
    assert 'file = "checks/mine.py"' in text and 'from = "robots.toml"' in text
    monkeypatch.chdir("/")
    assert (
        rj.Campaign.from_toml(tmp_path / "own.toml")
        == campaign
        == rj.Campaign.from_toml(campaign.to_toml())
    )
    assert str(tmp_path) in campaign.to_toml(tmp_path / "checks" / "other.toml")
    assert rj.Campaign.from_toml(tmp_path / "checks" / "other.toml") == campaign
    with pytest.raises(rj.StoreError, match="cannot be written"):
        campaign.to_toml(tmp_path / "nowhere" / "own.toml")
    with pytest.raises(rj.UserError, match="expected the path of a file to write"):
        campaign.to_toml(5)


def test_a_campaign_of_another_robot():
    campaign = rj.Campaign(
        name="arm",
        robot="planar_arm",
        parameters={"kp": 40},
        arms=["arm"],
        group=[
            {
                "name": "a",
                "fault": [
                    {
                        "site": "torque",
                        "channel": "elbow",
                        "effect": "offset",
                        "value": 1,
                        "start_ms": 5,
                    }
                ],
            }
        ],
    )
    assert (
        campaign.config.robot.name == "planar_arm" and 'robot = "planar_arm"' in campaign.to_toml()
    )
    assert rj.Campaign.from_toml(campaign.to_toml()) == campaign
    with pytest.raises(rj.UserError, match="expected 'sines'"):
        campaign.replace(operator=rj.Operator(motion="still"))
