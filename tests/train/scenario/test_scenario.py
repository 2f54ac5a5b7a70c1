"""Scenario files: what they may say, what is told of those that say something else, and the
campaigns they make.
"""

import pytest
from made_frames import made

from ravenjax.campaign.faults import design
from ravenjax.errors import UserError
from ravenjax.hazards import library
from ravenjax.train import scenario
from ravenjax.train.scenario import campaign as hazards

FILE = """
name = "written"
duration_s = 40
arms = ["gold", "green"]

[task]
kind = "reach"
targets = 4

[[hazard]]
name = "burst"
hazards = ["B27"]
arm = "green"
value = [1000, 2000]
when = [5, 20]
times = 2
right_response = ["release"]

[[hazard]]
name = "own"
title = "pushed"
[[hazard.fault]]
site = "usb_out"
channel = "elbow"
effect = "offset"
value = 700
duration_ms = 900
"""


def written(tmp_path, old="", new=""):
    assert not old or old in FILE
    path = tmp_path / "scenario.toml"
    path.write_text(FILE.replace(old, new) if old else FILE)
    return path


def refused(path, *overrides):
    with pytest.raises(UserError) as told:
        scenario.load_scenario(path, overrides)
    return str(told.value)


def table_of(chosen, seed=0):
    return design.table_columns(scenario.session_campaign(chosen, seed))


def test_a_file_becomes_a_campaign_of_one_row_a_hazard_and_the_button_last(tmp_path):
    chosen = scenario.load_scenario(
        written(tmp_path), ["task.targets=6", "cue.on=false", "hazard.own.within_s=3"]
    )
    assert chosen.task.kind == "reach" and chosen.task.targets == 6 and not chosen.cue.on
    config = scenario.session_campaign(chosen, 4)
    assert config.campaign.seed == 4 and config.campaign.duration_s == 40
    assert config.operator.scale == 0.1
    assert config.operator.motion == "still"
    assert config.haptics.cues()[0].threshold_m == pytest.approx(3e-3)
    table = table_of(chosen, 4)
    assert table["group"].tolist() == ["burst/B27#1", "burst/B27#2", "own/fault", "buttons/estop"]
    assert table["fault0_site"].tolist() == ["usb_out", "usb_out", "usb_out", "buttons"]
    assert table["fault0_arm"].tolist() == ["green", "green", "gold", ""]
    assert sorted(table["fault0_value"].tolist()[:2]) == [1000, 2000]  # times = 2: different rows
    assert table["fault0_start_ms"].tolist() == [0] * 4 and set(table["fault0_trigger"]) == {"time"}


def test_the_list_of_hazards_says_what_each_asks(tmp_path):
    chosen = scenario.load_scenario(written(tmp_path), ["hazard.own.within_s=3"])
    table = table_of(chosen)
    first, second, own = scenario.armable_hazards(chosen, table)
    assert (first.number, first.hazard, first.arm) == (0, "B27", "green")
    assert second.number == 1 and second.title == library.find_hazard("B27").title
    assert first.when_ms == (5000.0, 20000.0) and first.right_response == ("release",)
    # Bursts again and again have no end.
    assert first.lasts_ms == 5000
    assert own.title == "pushed" and own.hazard == "fault" and own.when_ms is None
    assert own.right_response == ("release", "slow", "stop")
    # The response's time and half a second.
    assert own.lasts_ms == 3500
    assert [int(one.run_id, 16) for one in (first, second, own)] == table["run_id"].tolist()[:3]
    assert first.header()["layer"] == library.library_layers()[library.find_hazard("B27").layer]


@pytest.mark.slow
def test_all_is_one_row_of_each_case_and_another_seed_takes_others():
    chosen, armable = made(duration_s=5, hazard=[{"name": "library", "hazards": "all"}])
    runnable = [row for row in library.all_hazards() if row.runnable]
    assert {one.hazard for one in armable} == {row.id for row in runnable}
    assert len(armable) == sum(len(row.case) for row in runnable)
    first, again, other = (table_of(chosen, seed) for seed in (0, 0, 1))
    assert first.equals(again)
    assert (first["fault0_value"] != other["fault0_value"]).sum() > 30


def test_parameters_are_drawn_once_for_all_hazards():
    keys = {
        "hazard": [{"hazards": ["B26"], "times": 3}],
        "parameters": {"plant": {"friction_scale": {"uniform": [0.5, 2]}}},
    }
    chosen, _ = made(**keys)
    drawn = [table_of(chosen, seed)["param:plant.friction_scale"] for seed in (1, 1, 2)]
    assert drawn[0].nunique() == 1 and 0.5 <= drawn[0][0] <= 2
    assert drawn[0][0] == drawn[1][0] != drawn[2][0]


def test_the_right_response_follows_from_what_the_hazard_does():
    _, armable = made(hazard=[{"hazards": ["C03", "B07", "B27", "K12"]}])
    right = {one.hazard: one.right_response for one in armable}
    assert right == {
        "C03": ("restart",),  # temporarily unavailable
        "B07": ("convert", "stop"),  # permanently
        "B27": ("release", "slow", "stop"),  # sudden jump
        "K12": ("continue",),  # nothing
    }
    assert all(
        hazards.right_responses(scenario.Entry(hazards=("B27",)), row)
        for row in library.all_hazards()
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"B27"', '"B72"', ":12: hazard[0].hazards: unknown hazard 'B72'"),
        ("when = [5, 20]", "when = [20, 5]", "hazard[0].when: got [20, 5]"),
        ('title = "pushed"', 'hazards = ["B27"]', "hazard[1]: expected either hazards ="),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, old, new, told):
    path = written(tmp_path, old, new)
    message = refused(path)
    assert str(path) in message and told in message


BUNDLED = scenario.bundled_scenarios()


@pytest.mark.parametrize("path", BUNDLED, ids=lambda path: path.stem)
def test_bundled_scenarios_load_by_name_and_make_campaigns(path):
    chosen = scenario.load_scenario(path.stem)
    assert chosen.name == path.stem and chosen.title and chosen.description
    table = table_of(chosen, chosen.seed)
    armable = scenario.armable_hazards(chosen, table)
    assert len(armable) == len(table) - 1 and table["group"].iloc[-1] == "buttons/estop"
    assert all(one.lasts_ms >= one.within_s * 1000 for one in armable)  # the response is seen
    # What session.json keeps is the scenario again.
    assert scenario.from_dict(chosen.resolved()).resolved() == chosen.resolved()
