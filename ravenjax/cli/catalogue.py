"""The commands `ravenjax campaigns`, `faults` and `parameters`, which list them."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    from ravenjax.analyses.search.file import loading as searches
    from ravenjax.bundled import resources
    from ravenjax.campaign import loading
    from ravenjax.campaign.faults import design
    from ravenjax.train import scenario

    kinds = {
        "campaigns": (loading.load_campaign, resources.list_resources("campaigns", "*.toml")),
        "searches": (searches.load_search, resources.list_resources(searches.FOLDER, "*.toml")),
        "scenarios": (scenario.load_scenario, scenario.bundled_scenarios()),
    }
    every: dict[str, Any] = {
        kind: {path.name: load(path) for path in paths} for kind, (load, paths) in kinds.items()
    }
    listings = console.fill_listings("campaigns.j2", count_rows=design.count_rows, **every)
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

    whose = robots.find_robot(robot)
    usual = bool(whose.hazards)
    layers = library.library_layers(whose) or whose.layers
    hazards = library.all_hazards(whose)
    ids = [row.id for row in hazards]
    lists = ["layers", "sites", "effects", "triggers", "phases"]
    lists += ["classes", "hazards"] if usual else []
    words = [*lists, *layers, *whose.sites, *EFFECTS, *ids]
    if word is not None and word not in words:
        raise UserError(
            f"unknown word {word!r}, expected a layer ({', '.join(layers)}), a site, an effect,"
            f"{' the id of a hazard,' if ids else ''} or one of"
            f" {', '.join(lists)}{suggest_name(word, words)}"
        )
    listings = console.fill_listings(
        "faults.j2",
        word=word,
        robot=whose,
        usual=usual,
        layers=layers,
        ids=ids,
        every_hazard=hazards,
        listing=listing,
        all_effects=EFFECTS,
        triggers=TRIGGERS,
        classes=library.library_terms()["classes"],
        parameter=PARAMETER,
        channels=_channels,
        without_fault=functools.partial(_without_fault, whose),
    )
    console.print_tables(listings, as_json)


def _channels(site: Site) -> str:
    # Return the channels of a site as text, grouped by type and unit.
    kinds: dict[str, list[str]] = {}
    for channel in site.channels:
        kinds.setdefault(f"{channel.kind} {channel.unit}", []).append(channel.name)
    return "; ".join(f"{' '.join(names)} ({kind})" for kind, names in kinds.items())


def _without_fault(robot: Robot, site: Site, channel: Channel) -> str:
    # Return the normal range of a channel for each arm, as text; "" if unknown.
    spans = {
        arm: f"{span.low:.4g}..{span.high:.4g}"
        for (of, arm, name), span in robot.ranges.items()
        if (of, name) == (site.name, channel.name)
    }
    alike = len(set(spans.values())) == 1
    return ", ".join(
        {*spans.values()} if alike else (f"{arm} {span}" for arm, span in spans.items())
    )


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
    config = (
        loading.load_campaign(file, changes, runs=False)
        if file is not None
        else loading.from_record({"campaign": {"name": "x"}, "group": [{"name": "x"}]}, changes)
    )
    loading.check_parameters(config)
    every = [
        row for row in parameter_rows(config) if not bounds.reserved_reason(config.robot, row[0])
    ]
    rows = [row for row in every if path in row[0]]
    if not rows:
        raise UserError(
            f"--path {path}: no parameter has this text in its"
            f" path{suggest_name(path, [row[0] for row in every])}"
        )
    console.print_tables([Listing("parameters", "Parameters", PARAMETER_COLUMNS, rows)], as_json)


PARAMETER_COLUMNS = ("path", "value", "may be", "meaning")


def parameter_rows(config: CampaignConfig) -> list[tuple[str, ...]]:
    """Return a row for each parameter of a campaign's robot: path, value, range, meaning."""
    from ravenjax.campaign import plan
    from ravenjax.campaign.file import bounds
    from ravenjax.numbers import paths

    program = plan.make_plan(config.model_copy(update={"parameters": {}})).program
    values: dict[str, list[str]] = {}
    for full, value in paths.path_leaves(program.params, program.setup):
        head, _, last = full.rpartition(".")
        if last in paths.path_words(config.robot.joints):
            values.setdefault(head, []).append(f"{last} {float(value):g}")
        else:
            values.setdefault(full, []).append(f"{float(value):g}")
    more = config.own_ranges
    # A campaign cannot vary a parameter without rules.
    rules = {full: bounds.allowed_values(config.robot, full, more) for full in values}
    rows = []
    for full, of in rules.items():
        if of:
            # A rule without names of joints applies to all joints.
            ranges = [f"{', '.join(rule.joints)}: {rule.range}".removeprefix(": ") for rule in of]
            rows.append((full, ", ".join(values[full]), "; ".join(ranges), of[0].meaning))
    return rows
