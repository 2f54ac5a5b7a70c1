"""Groups that name hazards become plain groups that a campaign accepts."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ravenjax.campaign import design, loading
from ravenjax.campaign.config import CampaignConfig
from ravenjax.errors import UserError
from ravenjax.hazards import expansion, library, naming
from ravenjax.hazards.expansion import WrongGroup, expand

RUNNABLE = [row.id for row in library.rows() if row.runnable]


def campaign(groups: list[dict[str, Any]], **fields: Any) -> CampaignConfig:
    return loading.from_dict({"campaign": {"name": "x", **fields}, "group": groups})


@pytest.mark.parametrize("hazard", RUNNABLE)
def test_a_campaign_accepts_each_runnable_hazard(hazard: str) -> None:
    groups = expand({"name": "g", "hazards": [hazard]})
    table = design.expand(campaign(groups))
    assert list(table["group"].astype(str).unique()) == [group["name"] for group in groups]
    assert all(group["name"].startswith(f"g/{hazard}") for group in groups)


def test_a_campaign_of_both_arms_accepts_all_of_them_with_an_arm() -> None:
    config = campaign(expand({"name": "g", "hazards": "all", "arm": "green"}), arms=["gold", "green"])
    arms = set(design.expand(config)["fault0_arm"].astype(str))
    assert arms == {"", "green"}


def test_all_ids_and_layers() -> None:
    assert [row.id for row in expansion.named("all")] == RUNNABLE
    assert {row.layer for row in expansion.named("L7")} == {"L7"}
    assert [row.id for row in expansion.named(["B24", "C09", "C09"])] == ["C09", "B24"]


def test_a_plain_group_stays_as_it_is() -> None:
    plain = {"name": "g", "parameters": {"operator.scale": [0.1]}}
    assert expand(plain) == [plain]


def test_overrides_replace_the_librarys_own() -> None:
    group = {"name": "g", "hazards": "B25", "start_ms": 900, "duration_ms": [3, 5], "value": {"uniform": [1, 2]}}
    (fault,) = expand(group | {"arm": "gold"})[0]["fault"]
    assert fault["start_ms"] == 900
    assert fault["duration_ms"] == [3, 5]
    assert fault["value"] == {"uniform": [1, 2]}
    assert fault["arm"] == "gold"
    assert "arm" not in expand({"name": "g", "hazards": "B18", "arm": "gold"})[0]["fault"][0]


def test_repeats_and_parameters_pass() -> None:
    group = {"name": "g", "hazards": ["B29"], "repeats": 3, "parameters": {"operator.scale": 0.2}}
    assert all(one["repeats"] == 3 and one["parameters"] == {"operator.scale": 0.2} for one in expand(group))


def test_scenario_a_strikes_three_axes_together() -> None:
    (group,) = expand({"name": "g", "hazards": "C09"})
    table = design.expand(campaign([group]))
    assert len(table) == 12 * 8
    assert [fault["channel"] for fault in group["fault"]] == ["x", "y", "z"]
    for name in ("value", "start_ms", "duration_ms"):
        assert (table[f"fault0_{name}"] == table[f"fault1_{name}"]).all()
        assert (table[f"fault0_{name}"] == table[f"fault2_{name}"]).all()
    assert sorted(table["fault0_value"].unique())[0] == math.floor(250 / math.sqrt(3))


@pytest.mark.parametrize(
    ("group", "message"),
    [
        ({"hazards": "C9"}, r"^hazards: unknown hazard 'C9', expected an id, a layer or 'all'. Did you mean 'C\d9'"),
        ({"hazards": ["M04"]}, r"^hazards: M04 \(piece of an instrument lost\) cannot be run: instruments that break"),
        ({"hazards": []}, r"^hazards: got \[\], expected ids and layers"),
        ({"hazards": 7}, r"^hazards: got 7, expected ids and layers"),
        ({"hazards": "C09", "fault": []}, r"^fault: unknown key in a group that names hazards, expected one of name"),
        ({"hazards": "C09", "start": 1}, r"^start: unknown key .* Did you mean 'start_ms'"),
        ({"hazards": "C19", "value": 1}, r"^value: C19 has effect 'drop', which takes none"),
        ({"hazards": "B30", "value": 1}, r"^value: B30 strikes 2 channels, each with a value of its own"),
        ({"hazards": "B16", "start_ms": [1, 2]}, r"^start_ms: B16 strikes several channels at once, expected one"),
        ({"hazards": "C09", "start_ms": {"uniform": [1, 2]}}, r"^start_ms: C09 strikes several .* got \{'uniform'"),
    ],
)
def test_what_is_wrong_is_told_with_its_key(group: dict[str, Any], message: str) -> None:
    with pytest.raises(WrongGroup, match=message):
        expand({"name": "g", **group})


def test_a_group_needs_a_name() -> None:
    with pytest.raises(WrongGroup, match=r"^name: missing"):
        expand({"hazards": "all"})


def test_a_campaigns_groups_know_where_they_were_written() -> None:
    raw = {"campaign": {"name": "x"}, "group": [{"name": "fault_free"}, {"name": "g", "hazards": ["C08", "B18"]}]}
    found, written = expansion.plain(raw)
    assert [group["name"] for group in found["group"]] == [
        "fault_free",
        "g/C08-in_range",
        "g/C08-out_of_range",
        "g/B18",
    ]
    assert written == [0, 1, 1, 1]
    assert "hazards" in raw["group"][1]  # what was given is left alone


def test_a_campaigns_wrong_group_is_told_with_its_number() -> None:
    with pytest.raises(WrongGroup) as told:
        expansion.plain({"group": [{"name": "fault_free"}, {"name": "g", "hazards": "Z1"}]})
    assert told.value.key == ("group", 1, "hazards")


@pytest.mark.parametrize("groups", [None, [], 3, ["C09"]])
def test_what_is_no_list_of_groups_stays(groups: Any) -> None:
    assert expansion.plain({"group": groups}) == ({"group": groups}, [])


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
    found = loading.load(file)
    assert found.group[0].name == "free" and {g.name.partition("/")[0] for g in found.group[1:]} == {"some"}
    assert all(set(fault.start_ms.values) == {900} for group in found.group[1:] for fault in group.fault)
    file.write_text(text.replace("START", "-900"))
    with pytest.raises(UserError, match=rf"{file}:1\d: group.1..*start_ms"):
        loading.load(file)
    file.write_text(text.replace('"C09"', '"C9"').replace("START", "900"))
    with pytest.raises(UserError, match=rf"{file}:14: group.1..hazards.*C9"):
        loading.load(file)


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


def test_every_expanded_group_tells_its_hazard() -> None:
    for row in library.rows():
        for group in expand({"name": "x/y", "hazards": row.id}) if row.runnable else ():
            assert naming.hazards_of(group["name"]) == (row.id,)
