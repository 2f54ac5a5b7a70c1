"""Groups that name hazards become plain groups that a campaign accepts."""

import math
from typing import Any

import pytest

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError
from ravenjax.hazards import library, naming
from ravenjax.hazards.expansion import WrongGroup, expand_group

RUNNABLE = [row.id for row in library.all_hazards() if row.runnable]


def campaign(groups: list[dict[str, Any]], **fields: Any) -> CampaignConfig:
    return loading.from_dict({"campaign": {"name": "x", **fields}, "group": groups})


@pytest.mark.parametrize("hazard", RUNNABLE)
def test_a_campaign_accepts_each_runnable_hazard(hazard: str) -> None:
    groups = expand_group({"name": "g", "hazards": [hazard]})
    table = design.table_columns(campaign(groups))
    assert list(table["group"].astype(str).unique()) == [group["name"] for group in groups]
    assert all(group["name"].startswith(f"g/{hazard}") for group in groups)


BOTH = ("gold", "green")


def both_arms(hazards: Any, **keys: Any) -> CampaignConfig:
    """A campaign of both arms that names hazards as a file does."""
    campaign = {"name": "x", "duration_s": 7.0, "arms": list(BOTH)}
    return loading.from_dict(
        {"campaign": campaign, "group": [{"name": "g", "hazards": hazards, **keys}]}
    )


def struck(config: CampaignConfig) -> dict[str, list[tuple[str, ...]]]:
    """Group -> the arms of the slots of its runs, each combination once."""
    table = design.table_columns(config)
    columns = [name for name in table if name.endswith("_arm")]
    rows = (
        table[["group", *columns]].astype(str).drop_duplicates().itertuples(index=False, name=None)
    )
    arms: dict[str, list[tuple[str, ...]]] = {}
    for group, *slots in rows:
        arms.setdefault(group, []).append(tuple(arm for arm in slots if arm))
    return arms


def test_with_both_arms_each_hazard_strikes_the_arm_of_its_source() -> None:
    """Gold or green that one, both in one run, any other each in turn, and what belongs to no
    arm once.
    """
    assert struck(both_arms(["C09", "K06", "K01", "B18", "C14"])) == {
        "g/C14-sag-gold": [("gold",)],
        "g/C14-sag-green": [("green",)],
        "g/C14-drift-gold": [("gold",)],
        "g/C14-drift-green": [("green",)],
        "g/C09": [("gold",) * 3],
        "g/K01-gold": [("gold",)],
        "g/K01-green": [("green",)],
        "g/K06": [("gold", "green")],
        "g/B18": [()],
    }


def test_a_hazard_of_both_arms_strikes_the_same_of_both() -> None:
    table = design.table_columns(both_arms("K06"))
    assert len(table) == 3 * 3
    for name in ("channel", "value", "start_ms"):
        assert (table[f"fault0_{name}"].astype(str) == table[f"fault1_{name}"].astype(str)).all()
    (group,) = expand_group({"name": "g", "hazards": "K06"}, BOTH)
    assert [fault["arm"] for fault in group["fault"]] == list(BOTH) and group["design"] == "zip"
    again = expand_group({"name": "g", "hazards": "K06", "start_ms": [1, 2]}, BOTH)
    assert [fault["start_ms"] for fault in again[0]["fault"]] == [[1, 2] * 3] * 2
    with pytest.raises(
        WrongGroup,
        match=r"^start_ms: K06 has faults on both arms in the same run, expected numbers",
    ):
        expand_group({"name": "g", "hazards": "K06", "start_ms": {"uniform": [1, 2]}}, BOTH)


def test_overrides_replace_the_librarys_own() -> None:
    group = {
        "name": "g",
        "hazards": "B25",
        "start_ms": 900,
        "duration_ms": [3, 5],
        "value": {"uniform": [1, 2]},
    }
    (fault,) = expand_group(group | {"arm": "gold"})[0]["fault"]
    assert fault["start_ms"] == 900
    assert fault["duration_ms"] == [3, 5]
    assert fault["value"] == {"uniform": [1, 2]}
    assert fault["arm"] == "gold"
    assert "arm" not in expand_group({"name": "g", "hazards": "B18", "arm": "gold"})[0]["fault"][0]


def test_scenario_a_strikes_three_axes_together() -> None:
    (group,) = expand_group({"name": "g", "hazards": "C09"})
    table = design.table_columns(campaign([group]))
    assert len(table) == 12 * 8
    assert [fault["channel"] for fault in group["fault"]] == ["x", "y", "z"]
    for name in ("value", "start_ms", "duration_ms"):
        assert (table[f"fault0_{name}"] == table[f"fault1_{name}"]).all()
        assert (table[f"fault0_{name}"] == table[f"fault2_{name}"]).all()
    assert sorted(table["fault0_value"].unique())[0] == math.floor(250 / math.sqrt(3))


def test_a_campaign_names_hazards_and_its_mistakes_are_told_where_they_stand(tmp_path):
    file = tmp_path / "mine.toml"
    text = """
[campaign]
name = "mine"
duration_s = 2.0

[operator]
motion = "reach"

[[group]]
name = "free"

[[group]]
name = "some"
hazards = ["C09", "L7"]
start_ms = START
"""
    file.write_text(text.replace("START", "900"))
    found = loading.load_campaign(file)
    assert found.group[0].name == "free" and {
        g.name.partition("/")[0] for g in found.group[1:]
    } == {"some"}
    assert all(
        set(fault.start_ms.values) == {900} for group in found.group[1:] for fault in group.fault
    )
    file.write_text(text.replace("START", "-900"))
    with pytest.raises(UserError, match=rf"{file}:1\d: group.1..*start_ms"):
        loading.load_campaign(file)
    file.write_text(text.replace('"C09"', '"C9"').replace("START", "900"))
    with pytest.raises(UserError, match=rf"{file}:14: group.1..hazards.*C9"):
        loading.load_campaign(file)


@pytest.mark.parametrize(
    ("group", "ids"),
    [
        ("library/B24", ("B24",)),
        ("library/C01-below", ("C01",)),
        ("B07,B08,B10 boards not written", ("B07", "B08", "B10")),
        ("K15-K17 run level stuck", ("K15", "K16", "K17")),
        ("both/K06", ("K06",)),
        ("fault_free", ()),
        ("C09x", ()),
    ],
)
def test_hazards_of_a_group(group: str, ids: tuple[str, ...]) -> None:
    assert naming.hazards_of(group) == ids
