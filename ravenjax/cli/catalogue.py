"""Commands that list what exists: `campaigns`, `faults`, `parameters`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ravenjax import robots
from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing, Overrides
from ravenjax.vocabulary.sites import PARAMETER

if TYPE_CHECKING:
    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.vocabulary.robot import Robot
    from ravenjax.vocabulary.sites import Site


def campaigns(*, as_json: AsJson = False) -> None:
    """List the bundled campaigns, searches and training scenarios."""
    from ravenjax.analyses.search.file import loading as searches
    from ravenjax.bundled import resources
    from ravenjax.campaign import loading
    from ravenjax.campaign.faults import design
    from ravenjax.train import scenario

    every = {
        "campaigns": {
            path.name: loading.load_campaign(path)
            for path in resources.list_resources("campaigns", "*.toml")
        },
        "searches": {
            path.name: searches.load_search(path)
            for path in resources.list_resources("campaigns/searches", "*.toml")
        },
        "scenarios": {
            path.name: scenario.load_scenario(path) for path in scenario.bundled_scenarios()
        },
    }
    listings = console.fill_listings("campaigns.j2", count_rows=design.count_rows, **every)
    console.print_tables(listings, as_json)


def faults(
    word: str | None = None, *, robot: str = robots.DEFAULT, as_json: AsJson = False
) -> None:
    """List layers, fault sites and channels, effects, triggers, and the hazard library.

    Parameters
    ----------
    word
        Show this alone: a layer (L7), a site (usb_out), an effect (drift), a hazard (C09), or
        one of layers, sites, effects, triggers, phases (of an operation), classes (of
        outcomes), hazards.
    robot
        whose sites: raven2, or the module that declares another one, for which there are no
        hazards
    """
    console.print_tables(list(_faults(word, robots.find_robot(robot))), as_json)


def _faults(word: str | None, robot: Robot) -> Iterator[Listing]:
    from ravenjax.errors import UserError, suggest_name
    from ravenjax.hazards import library, listing
    from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS

    # The library of hazards is that of the usual robot.
    usual = robot is robots.USUAL
    layers = library.library_layers() if usual else robot.layers
    meaning = ("effect", "meaning")
    every = {
        "layers": Listing(
            "layers",
            "Layers of the loop",
            listing.LAYER_COLUMNS if usual else ("layer", "what"),
            listing.layer_table() if usual else list(layers.items()),
        ),
        "sites": _sites(
            "Sites, in the robot's order; `ravenjax faults SITE` shows one", robot.sites.values()
        ),
        "effects": Listing("effects", "Effects", meaning, [e[:2] for e in EFFECTS.values()]),
        "triggers": Listing(
            "triggers", "Triggers", ("trigger", "start_ms counts"), list(TRIGGERS.items())
        ),
        "phases": Listing(
            "phases", "Phases of an operation", ("phase", "when"), list(robot.phases.items())
        ),
    }
    if usual:
        every["classes"] = Listing(
            "classes",
            "Outcome classes of hazards",
            ("class", "meaning"),
            list(library.library_terms()["classes"].items()),
        )
        every["hazards"] = Listing(
            "hazards",
            "Hazards; `ravenjax faults ID` shows one, `hazards = [ID, ..]` in a [[group]] runs it",
            listing.COLUMNS,
            listing.hazard_table(),
        )
    ids = [row.id for row in library.all_hazards()] if usual else []
    if word is None:
        yield from every.values()
    elif word in every:
        yield every[word]
    elif word in layers:
        sites = [site for site in robot.sites.values() if site.layer == word]
        yield _sites(f"{word}, {layers[word]}: sites", sites)
        if usual:
            rows = listing.hazard_table(listing.of_layer(word))
            yield Listing("hazards", f"{word}: hazards", listing.COLUMNS, rows)
    elif word in robot.sites:
        yield from _site(robot.sites[word], layers, usual)
    elif word in EFFECTS:
        yield Listing("effect", f"Effect {word}", meaning, [EFFECTS[word][:2]])
    elif word in ids:
        yield Listing("hazard", f"Hazard {word}", ("what", "is"), listing.describe_hazard(word))
    else:
        words = [*every, *layers, *robot.sites, *EFFECTS, *ids]
        raise UserError(
            f"unknown word {word!r}, expected a layer ({', '.join(layers)}), a site, an effect,"
            f"{' the id of a hazard,' if ids else ''} or one of"
            f" {', '.join(every)}{suggest_name(word, words)}"
        )


def _sites(title: str, sites: Iterable[Site]) -> Listing:
    rows = []
    for site in sites:
        kinds: dict[str, list[str]] = {}
        for channel in site.channels:
            kinds.setdefault(f"{channel.kind} {channel.unit}", []).append(channel.name)
        channels = "; ".join(f"{' '.join(group)} ({kind})" for kind, group in kinds.items())
        each_arm = "each arm: " if site.per_arm else ""
        rows.append((site.layer, site.name, each_arm + channels, site.where))
    return Listing("sites", title, ("layer", "site", "channels (number, unit)", "where"), rows)


def _site(site: Site, layers: Mapping[str, str], usual: bool) -> Iterator[Listing]:
    from ravenjax.hazards import listing, ranges
    from ravenjax.vocabulary.effects import EFFECTS

    about = [
        ("layer", f"{site.layer}: {layers[site.layer]}"),
        ("where", site.where),
        ("arm", "on each arm: with both, write arm" if site.per_arm else "of no arm"),
    ]
    yield Listing("site", f"Site {site.name}", ("what", "is"), about)
    measured = ranges.measured_ranges() if usual else {}
    channels = []
    for channel in site.channels:
        spans = {
            arm: f"{span.low:.4g}..{span.high:.4g}"
            for (of, arm, name), span in measured.items()
            if (of, name) == (site.name, channel.name)
        }
        alike = len(set(spans.values())) == 1
        without_fault = ", ".join(
            {*spans.values()} if alike else (f"{arm} {span}" for arm, span in spans.items())
        )
        channels.append((channel.name, channel.kind, channel.unit, without_fault))
    if site.name == PARAMETER:
        channels = [("PATH", "as it is", "as it is", "`ravenjax parameters` lists the paths")]
    columns = ("channel", "number", "unit", "without a fault")
    yield Listing("channels", "Channels", columns, channels)
    effects = [
        effect[:2]
        for effect in EFFECTS.values()
        if effect.network is None or site.name == "network"
    ]
    yield Listing("effects", "Effects that it takes", ("effect", "meaning"), effects)
    if usual:
        hazards = listing.hazard_table(listing.of_site(site.name))
        yield Listing("hazards", "Hazards that act there", listing.COLUMNS, hazards)


def parameters(
    file: Path | None = None,
    *,
    path: str = "",
    robot: str | None = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """List the parameters that a campaign may vary, with default, range and meaning.

    A path names one number, or a vector with one number per joint or axis; PATH.elbow names
    that of the elbow.

    Parameters
    ----------
    file
        Campaign file; its software, arms and tools decide what there is. Without one: one arm,
        software raven2.
    path
        only paths that hold this text, as plant or kp
    robot
        of this robot instead: raven2, or the module that declares another one
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
            f"--path {path}: no parameter's path holds"
            f" it{suggest_name(path, [row[0] for row in every])}"
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
    return [
        (
            full,
            ", ".join(values[full]),
            "; ".join(
                f"{', '.join(rule.joints)}: {rule.range}" if rule.joints else rule.range
                for rule in of
            ),
            of[0].meaning,
        )
        for full, of in rules.items()
        if of
    ]
