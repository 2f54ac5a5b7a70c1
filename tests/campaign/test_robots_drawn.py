"""Robots of a file in a campaign: drawn whole, with what the campaign itself says going before."""

from pathlib import Path

import pytest
import tiny_campaign

import ravenjax as rj
from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from ravenjax.errors import UserError

COULOMB, OFFSET = "plant.gold.actuators.coulomb.shoulder", "plant.gold.actuators.bias.shoulder"
ROBOTS = f"""[campaign]
parameter_set = "power_consistent"

[parameters]
"{COULOMB}" = {{ together = [0.02, 0.03, 0.04] }}
"{OFFSET}" = {{ together = [0.2, 0.3, 0.4] }}
"""


def tables(**parameters) -> dict:
    one = tiny_campaign.tables(runs=203)
    one["group"] = one["group"][1:]
    return {**one, "parameters": parameters}


def loaded(folder: Path, robots: str = ROBOTS, **own):
    (folder / "my_robot.toml").write_text(robots)
    raw = tables(**{"from": "my_robot.toml"}, **own.pop("parameters", {}))
    raw["campaign"] |= own
    return loading.from_dict(raw, source=folder / "campaign.toml")


@pytest.mark.parametrize("kind", ["random", "lhs", "sobol"])
def test_numbers_of_one_robot_stay_together(tmp_path, kind) -> None:
    (tmp_path / "my_robot.toml").write_text(ROBOTS)
    raw = tables(**{"from": "my_robot.toml"})
    raw["group"][0]["design"] = kind
    rows = design.table_columns(loading.from_dict(raw, source=tmp_path / "campaign.toml"))
    drawn = rows[[f"param:{COULOMB}", f"param:{OFFSET}"]].drop_duplicates()
    assert sorted(drawn.itertuples(index=False, name=None)) == [
        (0.02, 0.2),
        (0.03, 0.3),
        (0.04, 0.4),
    ]
    shares = rows[f"param:{COULOMB}"].value_counts(normalize=True)
    assert (shares > 0.2).all()


def test_the_file_chooses_the_mechanics_its_numbers_hold_for(tmp_path) -> None:
    assert loaded(tmp_path).campaign.parameter_set == "power_consistent"
    with pytest.raises(UserError, match="parameter_set: got 'traj3', but the parameters in"):
        loaded(tmp_path, parameter_set="traj3")


def test_what_the_campaign_says_goes_before_the_file(tmp_path) -> None:
    config = loaded(tmp_path, parameters={COULOMB: 0.05})
    assert (
        config.parameters[COULOMB].values == (0.05,)
        and config.parameters[OFFSET].kind == "together"
    )


@pytest.mark.parametrize(
    ("robots", "message"),
    [
        ("[parameters", "not valid TOML"),
        ("[group]\nname = 1", r"has group, expected only \[campaign\] and \[parameters\]"),
        (ROBOTS.replace(", 0.4]", "]"), "together needs lists of one length, got lengths"),
    ],
)
def test_a_bad_file_of_robots_is_refused(tmp_path, robots, message) -> None:
    with pytest.raises(UserError, match=message):
        rj.run(loaded(tmp_path, robots))


def test_a_missing_file_and_another_value_are_refused(tmp_path) -> None:
    with pytest.raises(UserError, match=r"parameters\.from: found no file .*ravenjax calibrate"):
        loading.from_dict(tables(**{"from": "absent.toml"}), source=tmp_path / "campaign.toml")
    with pytest.raises(UserError, match=r"parameters\.from: got 3, expected the path"):
        loading.from_dict(tables(**{"from": 3}))
