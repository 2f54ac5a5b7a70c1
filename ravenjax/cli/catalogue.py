"""The commands `ravenjax campaigns`, `faults` and `parameters`, which list what they name."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

from ravenjax import robots
from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing, Overrides
from ravenjax.vocabulary.sites import PARAMETER

if TYPE_CHECKING:
    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.vocabulary.robot import Robot
    from ravenjax.vocabulary.sites import Channel, Site


def campaigns(*, as_json: AsJson = False) -> None:
    """List the bundled campaigns, searches and training scenarios."""
    from ravenjax import resources
    from ravenjax.analyses.search.file import loading as searches
    from ravenjax.campaign import loading
    from ravenjax.campaign.faults import design
    from ravenjax.train import scenario

    campaign_paths = resources.list_resources("campaigns", "*.toml")
    search_paths = resources.list_resources(searches.FOLDER, "*.toml")
    scenario_paths = scenario.bundled_scenarios()
    listings = console.fill_listings(
        "campaigns.j2",
        count_rows=design.count_rows,
        campaigns={path.name: loading.load_campaign(path) for path in campaign_paths},
        searches={path.name: searches.load_search(path) for path in search_paths},
        scenarios={path.name: scenario.load_scenario(path) for path in scenario_paths},
    )
    console.print_tables(listings, as_json)


def faults(
    word: str | None = None, *, robot: str = robots.DEFAULT, as_json: AsJson = False
) -> None:
    """List layers, fault sites and channels, effects, triggers, and the hazard library.

    Args:
        word: Show only this: a layer (L7), a fault site (usb_out), an effect (drift), a hazard
            (C09), or one of the lists layers, sites, effects, triggers, phases (of an operation),
            classes (of outcomes), hazards.
        robot: raven2, or the Python module that declares another robot; only raven2 has a hazard
            library
    """
    from ravenjax.errors import UserError, suggest_name
    from ravenjax.hazards import library, listing
    from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS

    declaration = robots.find_robot(robot)
    has_library = bool(declaration.hazards)
    layers = library.library_layers(declaration) or declaration.layers
    hazards = library.all_hazards(declaration)
    hazard_ids = [row.id for row in hazards]
    list_names = ["layers", "sites", "effects", "triggers", "phases"]
    list_names += ["classes", "hazards"] if has_library else []
    known_words = [*list_names, *layers, *declaration.sites, *EFFECTS, *hazard_ids]
    if word is not None and word not in known_words:
        raise UserError(
            f"unknown word {word!r}, expected a layer ({', '.join(layers)}), a site, an effect,"
            f"{' the id of a hazard,' if hazard_ids else ''} or one of"
            f" {', '.join(list_names)}{suggest_name(word, known_words)}"
        )
    listings = console.fill_listings(
        "faults.j2",
        word=word,
        robot=declaration,
        has_library=has_library,
        layers=layers,
        hazard_ids=hazard_ids,
        all_hazards=hazards,
        listing=listing,
        all_effects=EFFECTS,
        triggers=TRIGGERS,
        classes=library.library_terms()["classes"],
        parameter=PARAMETER,
        channels=_describe_channels,
        normal_range=functools.partial(_describe_normal_range, declaration),
    )
    console.print_tables(listings, as_json)


def _describe_channels(site: Site) -> str:
    # Returns the names of a site's channels, grouped by type and unit: "x y z (float m); ...".
    names_by_type: dict[str, list[str]] = {}
    for channel in site.channels:
        names_by_type.setdefault(f"{channel.kind} {channel.unit}", []).append(channel.name)
    return "; ".join(f"{' '.join(names)} ({type_})" for type_, names in names_by_type.items())


def _describe_normal_range(robot: Robot, site: Site, channel: Channel) -> str:
    # Returns the normal range of a channel for each arm: "gold -1..1, green -2..2". If the ranges
    # of all arms are equal, returns only this range; if no range is known, "".
    range_of_arm = {
        arm: f"{limits.low:.4g}..{limits.high:.4g}"
        for (site_name, arm, channel_name), limits in robot.ranges.items()
        if (site_name, channel_name) == (site.name, channel.name)
    }
    if len(set(range_of_arm.values())) == 1:
        return next(iter(range_of_arm.values()))
    return ", ".join(f"{arm} {limits}" for arm, limits in range_of_arm.items())


def parameters(
    file: Path | None = None,
    *,
    path: str = "",
    robot: str | None = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """List the parameters that a campaign may vary, with default, range and meaning.

    A path names one number, or a vector with one number per joint or axis. PATH.elbow names
    the number of the elbow.

    Args:
        file: Campaign file; its software, arms and tools determine the parameters. Default: one arm
            with the software raven2.
        path: only paths that contain this text, such as plant or kp
        robot: another robot than the campaign's: raven2, or the Python module that declares it
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.file import bounds
    from ravenjax.errors import UserError, suggest_name

    changes = [*(overrides or ()), *([] if robot is None else [f"campaign.robot={robot}"])]
    if file is not None:
        config = loading.load_campaign(file, changes, runs=False)
    else:
        # The smallest valid campaign has one arm and the software raven2.
        config = loading.from_record({"campaign": {"name": "x"}, "group": [{"name": "x"}]}, changes)
    loading.check_parameters(config)
    # A reserved parameter is set by another key of the campaign, so [parameters] may not set it.
    allowed = {
        row[0]: row
        for row in parameter_rows(config)
        if not bounds.reserved_reason(config.robot, row[0])
    }
    rows = [row for full_path, row in allowed.items() if path in full_path]
    if not rows:
        raise UserError(
            f"--path {path}: no parameter has this text in its path{suggest_name(path, allowed)}"
        )
    console.print_tables([Listing("parameters", "Parameters", PARAMETER_COLUMNS, rows)], as_json)


PARAMETER_COLUMNS = ("path", "value", "may be", "meaning")


def parameter_rows(config: CampaignConfig) -> list[tuple[str, ...]]:
    """Return a row (PARAMETER_COLUMNS) for each parameter of a campaign's robot. A vector is one
    row, with values such as "elbow 1, wrist 2".
    """
    from ravenjax.campaign import plan
    from ravenjax.campaign.file import bounds
    from ravenjax.numbers import paths

    program = plan.make_plan(config.model_copy(update={"parameters": {}})).program
    values: dict[str, list[str]] = {}
    for number_path, value in paths.path_leaves(program.params, program.setup):
        vector_path, _, joint_or_axis = number_path.rpartition(".")
        if joint_or_axis in paths.path_words(config.robot.joints):
            values.setdefault(vector_path, []).append(f"{joint_or_axis} {float(value):g}")
        else:
            values.setdefault(number_path, []).append(f"{float(value):g}")
    rows = []
    for path, texts in values.items():
        rules = bounds.allowed_values(config.robot, path, config.own_ranges)
        # A rule without names of joints applies to all joints.
        ranges = [f"{', '.join(rule.joints)}: {rule.range}".removeprefix(": ") for rule in rules]
        # A campaign cannot vary a parameter without rules.
        if rules:
            rows.append((path, ", ".join(texts), "; ".join(ranges), rules[0].meaning))
    return rows
