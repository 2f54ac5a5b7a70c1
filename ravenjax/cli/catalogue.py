"""Commands that say what there is: `campaigns`, `faults`, `parameters`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing, Overrides

if TYPE_CHECKING:
    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.vocabulary.sites import Channel, Site


def campaigns(*, as_json: AsJson = False) -> None:
    """List the bundled campaigns, searches and training scenarios."""
    from ravenjax.analyses.search.file import loading as searches
    from ravenjax.bundled import resources
    from ravenjax.campaign import loading
    from ravenjax.campaign.faults import design
    from ravenjax.train import scenario

    files = [(path.name, loading.load(path)) for path in resources.bundled("campaigns", "*.toml")]
    templates = [
        (path.name, searches.load(path))
        for path in resources.bundled("campaigns/searches", "*.toml")
    ]
    scenarios = [(path.name, scenario.load(path)) for path in scenario.bundled()]
    console.emit(
        [
            Listing(
                "campaigns",
                "Campaigns: ravenjax run FILE",
                ("file", "runs", "what it asks"),
                [(name, str(design.count(one)), one.campaign.description) for name, one in files],
            ),
            Listing(
                "searches",
                "Searches: ravenjax search FILE",
                ("file", "kind", "what it asks"),
                [
                    (name, one.search.kind, one.campaign.campaign.description)
                    for name, one in templates
                ],
            ),
            Listing(
                "training",
                "Training: ravenjax train FILE",
                ("file", "s", "what it trains"),
                [(name, f"{one.duration_s:g}", one.title) for name, one in scenarios],
            ),
        ],
        as_json,
    )


def faults(word: str | None = None, *, as_json: AsJson = False) -> None:
    """List layers, fault sites and channels, effects, triggers, and the hazard library.

    Parameters
    ----------
    word
        Show this alone: a layer (L7), a site (usb_out), an effect (drift), a hazard (C09), or
        one of layers, sites, effects, triggers, phases (of an operation), classes (of
        outcomes), hazards.
    """
    console.emit(list(_faults(word)), as_json)


def _faults(word: str | None) -> Iterator[Listing]:
    from ravenjax.errors import UserError, suggestion
    from ravenjax.hazards import library, listing
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.vocabulary.effects import EFFECTS, TRIGGERS

    every: dict[str, Callable[[], Listing]] = {
        "layers": lambda: Listing(
            "layers", "Layers of the loop", listing.LAYER_COLUMNS, listing.layers()
        ),
        "sites": lambda: _sites(
            "Sites, in the robot's order; `ravenjax faults SITE` shows one", list(ROBOT.sites)
        ),
        "effects": lambda: Listing(
            "effects", "Effects", ("effect", "meaning"), [effect[:2] for effect in EFFECTS.values()]
        ),
        "triggers": lambda: Listing(
            "triggers", "Triggers", ("trigger", "start_ms counts"), list(TRIGGERS.items())
        ),
        "phases": lambda: Listing(
            "phases", "Phases of an operation", ("phase", "when"), list(ROBOT.phases.items())
        ),
        "classes": lambda: Listing(
            "classes",
            "Outcome classes of hazards",
            ("class", "meaning"),
            list(library.terms()["classes"].items()),
        ),
        "hazards": lambda: Listing(
            "hazards",
            "Hazards; `ravenjax faults ID` shows one, `hazards = [ID, ..]` in a [[group]] runs it",
            listing.COLUMNS,
            listing.table(),
        ),
    }
    if word is None:
        yield from (table() for table in every.values())
    elif word in every:
        yield every[word]()
    elif word in library.layers():
        yield _sites(
            f"{word}, {library.layers()[word]}: sites",
            [s.name for s in ROBOT.sites.values() if s.layer == word],
        )
        yield Listing(
            "hazards", f"{word}: hazards", listing.COLUMNS, listing.table(listing.of_layer(word))
        )
    elif word in ROBOT.sites:
        yield from _site(word)
    elif word in EFFECTS:
        yield from _effect(word)
    else:
        ids = [row.id for row in library.rows()]
        if word not in ids:
            words = [*every, *library.layers(), *ROBOT.sites, *EFFECTS, *ids]
            raise UserError(
                f"unknown word {word!r}, expected a layer (L1 to L10), a site, an effect, the id of"
                f" a hazard, or one of {', '.join(every)}{suggestion(word, words)}"
            )
        yield Listing("hazard", f"Hazard {word}", ("what", "is"), listing.description(word))


def _sites(title: str, names: Sequence[str]) -> Listing:
    from ravenjax.robots.raven2 import ROBOT

    rows = []
    for site in (ROBOT.sites[name] for name in names):
        kinds: dict[str, list[str]] = {}
        for channel in site.channels:
            kinds.setdefault(f"{channel.kind} {channel.unit}", []).append(channel.name)
        channels = "; ".join(f"{' '.join(group)} ({kind})" for kind, group in kinds.items())
        rows.append(
            (site.layer, site.name, ("each arm: " if site.per_arm else "") + channels, site.where)
        )
    return Listing("sites", title, ("layer", "site", "channels (number, unit)", "where"), rows)


def _site(name: str) -> Iterator[Listing]:
    from ravenjax.hazards import library, listing
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.vocabulary.effects import EFFECTS

    site = ROBOT.sites[name]
    about = [
        ("layer", f"{site.layer}: {library.layers()[site.layer]}"),
        ("where", site.where),
        ("arm", "on each arm: with both, write arm" if site.per_arm else "of no arm"),
    ]
    yield Listing("site", f"Site {name}", ("what", "is"), about)
    yield Listing(
        "channels",
        "Channels",
        ("channel", "number", "unit", "without a fault"),
        [(one.name, one.kind, one.unit, _normal_range(site, one)) for one in site.channels],
    )
    yield Listing(
        "effects",
        "Effects that it takes",
        ("effect", "meaning", "value"),
        [
            (effect.name, effect.meaning, _effect_values(site, effect.name))
            for effect in EFFECTS.values()
            if effect.network is None or name == "network"
        ],
    )
    yield Listing(
        "hazards", "Hazards that strike it", listing.COLUMNS, listing.table(listing.of_site(name))
    )


def _effect(name: str) -> Iterator[Listing]:
    from ravenjax.robots.raven2 import ROBOT
    from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS

    yield Listing("effect", f"Effect {name}", ("what", "is"), [("meaning", EFFECTS[name].meaning)])
    sites = [
        site
        for site in ROBOT.sites.values()
        if name not in NETWORK_EFFECTS or site.name == "network"
    ]
    rows = [(site.name, _effect_values(site, name)) for site in sites]
    yield Listing("values", "Its value", ("site", "may be"), rows)


def _effect_values(site: Site, effect: str) -> str:
    """What the value of an effect may be at the channels of a site, in words."""
    from ravenjax.vocabulary.effects import NETWORK_EFFECTS, WITHOUT_VALUE

    if effect in WITHOUT_VALUE:
        return "takes none"
    aimed = (
        [site.channel(NETWORK_EFFECTS[effect][0])] if effect in NETWORK_EFFECTS else site.channels
    )
    spans: dict[str, list[str]] = {}
    for channel in aimed:
        spans.setdefault(_value_range(site, channel, effect), []).append(channel.name)
    if len(spans) == 1:
        return next(iter(spans))
    return "; ".join(f"{', '.join(names)}: {span}" for span, names in spans.items())


def _value_range(site: Site, channel: Channel, effect: str) -> str:
    from ravenjax.vocabulary.effects import EFFECTS
    from ravenjax.vocabulary.legal import legal

    rule = legal(channel, effect)
    low, high = rule.low, rule.high
    if effect == "bit_flip":
        return f"bit {low:.0f}..{high:.0f}"
    if effect == "delay":
        return f"{low:.0f}..{high:.0f} packets, whole"
    if effect == "scale":
        return "any factor"
    if channel.field and EFFECTS[effect].value == "number":
        low, high = channel.field.low, channel.field.high
    unit = "" if channel.unit == "1" else f" {channel.unit}"
    if math.isinf(low):
        return f"any number{unit and f', in{unit}'}"
    beyond = ""
    if channel.kind == "int16":
        beyond = ", beyond with wraps = true" + (" or campaign.dac_words" if site.beyond else "")
    return f"{low:.10g}..{high:.10g}{unit}{', whole' if rule.whole else ''}{beyond}"


def _normal_range(site: Site, channel: Channel) -> str:
    """The range of a channel in fault-free runs, of each arm where they differ."""
    from ravenjax.errors import UserError
    from ravenjax.hazards import ranges
    from ravenjax.robots.raven2 import ROBOT

    spans = {}
    for arm in ROBOT.arms if site.per_arm else ROBOT.arms[:1]:
        try:
            normal = ranges.normal(site.name, channel.name, arm)
        except UserError:
            continue
        spans[arm] = f"{normal.low:.4g}..{normal.high:.4g}"
    if len(set(spans.values())) == 1:
        return next(iter(spans.values()))
    return ", ".join(f"{arm} {span}" for arm, span in spans.items())


def parameters(
    file: Path | None = None,
    *,
    path: str = "",
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
    """
    from ravenjax.campaign import loading
    from ravenjax.campaign.file import bounds
    from ravenjax.errors import UserError, suggestion

    plain = {"campaign": {"name": "plain"}, "group": [{"name": "plain"}]}
    config = (
        loading.load(file, overrides or ())
        if file is not None
        else loading.from_dict(plain, overrides=overrides or ())
    )
    loading.check_parameters(config)
    every = parameter_rows(config)
    rows = [row for row in every if path in row[0] and not bounds.reserved(config.robot, row[0])]
    if not rows:
        raise UserError(
            f"--path {path}: no parameter's path holds"
            f" it{suggestion(path, [row[0] for row in every])}"
        )
    console.emit([Listing("parameters", "Parameters", PARAMETER_COLUMNS, rows)], as_json)


PARAMETER_COLUMNS = ("path", "value", "may be", "meaning")


def parameter_rows(config: CampaignConfig) -> list[tuple[str, ...]]:
    """One row for each parameter of a campaign's robot: path, the value that it has, its range,
    its meaning.
    """
    from ravenjax.campaign import plan
    from ravenjax.campaign.file import bounds
    from ravenjax.numbers import paths
    from ravenjax.robots.raven2.arms import JOINTS

    program = plan.make_plan(config.model_copy(update={"parameters": {}})).program
    values: dict[str, list[str]] = {}
    for full, value in paths.leaves(program.params, program.setup):
        head, _, last = full.rpartition(".")
        if last in paths.components(JOINTS):
            values.setdefault(head, []).append(f"{last} {float(value):g}")
        else:
            values.setdefault(full, []).append(f"{float(value):g}")
    more = config.own_ranges
    rules = {
        full: bounds.of(config.robot, full, more) for full in values
    }  # none: not a campaign's to vary
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
