"""The reference of campaign files is complete and what lies in the repository is up to date."""

from __future__ import annotations

import re

from ravenjax import robots
from ravenjax.bundled import resources
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection import reference
from ravenjax.campaign.loading import header, tables_of
from ravenjax.hazards.expansion import KEYS
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.sites import SITES
from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS


def sections() -> dict[str, dict[str, list[str]]]:
    """Heading -> first cell of each row -> its cells."""
    tables: dict[str, dict[str, list[str]]] = {}
    title = ""
    for line in reference.page(robots.USUAL).splitlines():
        if line.startswith("## "):
            title = line.removeprefix("## ")
        elif line.startswith("| ") and "---" not in line:
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            tables.setdefault(title, {})[cells[0].strip("`")] = cells
    return tables


def test_the_page_in_the_repository_is_the_one_that_is_written_now():
    file = resources.bundled("campaigns", "*.toml")[0].with_name("REFERENCE.md")
    assert file.read_text(encoding="utf-8") == reference.page(robots.USUAL), (
        f"write it anew: {reference.COMMAND}"
    )


def test_every_key_of_every_table_has_a_meaning():
    page = sections()
    for path, model in tables_of(CampaignConfig):
        for name, field in model.model_fields.items() if path else ():
            inner = (*path, name)
            if inner in dict(tables_of(CampaignConfig)):
                assert header(inner) in page
                continue
            key, kind, _, _, default, meaning = page[header(path)][name]
            assert key == f"`{name}`" and kind and meaning, inner
            assert (default == "required") == field.is_required(), inner


def test_units_ranges_and_defaults():
    page = sections()
    assert page["[campaign]"]["duration_s"][2:5] == ["s", "above 0, to 3600", "`3.0`"]
    assert page["[campaign]"]["software"][1] == "`raven2`, `fork2015`"
    assert page["[limits]"]["elbow_deg"][1:4] == ["two numbers", "deg", "45 to 137.5"]
    assert page["[[group.fault]]"]["duration_ms"][1:5] == [
        "whole number, axis",
        "ms",
        '1 to 1000000000, or "end"',
        "`end`",
    ]
    assert page["[[group.fault]]"]["trigger"][1:5] == ["name, axis", "", "", "`time`"]
    assert page["[[group]]"]["runs"][3] == "from 1, to 100000000"
    assert page["[[group]]"]["parameters"][1] == "paths of numbers, axis"


def test_every_word_of_a_file_is_there():
    page = sections()
    assert set(page["[[group]] that names hazards"]) - {"key"} == set(KEYS)
    assert {path for path, _ in bounds.rows(ROBOT)} <= {
        path.partition("`")[0] for path in page["[parameters], [cross]"]
    }
    assert set(SITES) < set(page["Layers and sites"])
    assert set(EFFECTS) < set(page["Effects"]) and set(TRIGGERS) < set(page["Triggers"])
