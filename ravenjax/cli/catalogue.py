"""Commands that tell what there is: `campaigns`, `faults`, `parameters`."""

from __future__ import annotations

from ravenjax.cli import console
from ravenjax.cli.console import Overrides


def campaigns() -> None:
    """List the bundled campaigns, searches and training scenarios."""
    from ravenjax import resources, terminal
    from ravenjax.campaign import design, loading

    rows = []
    for path in resources.bundled("campaigns", "*.toml"):
        config = loading.load(path)
        rows.append((path.name, str(design.count(config)), config.campaign.description))
    console.out.print(terminal.table("Campaigns: ravenjax run FILE", ("file", "runs", "what it asks"), rows))
    from ravenjax.search import loading as searches

    found = [(path.name, searches.load(path)) for path in resources.bundled("campaigns/searches", "*.toml")]
    rows = [(name, one.search.kind, one.campaign.campaign.description) for name, one in found]
    console.out.print()
    console.out.print(terminal.table("Searches: ravenjax search FILE", ("file", "kind", "what it asks"), rows))
    from ravenjax.trainer import scenario

    chosen = [(path.name, scenario.load(path)) for path in scenario.bundled()]
    rows = [(name, f"{one.duration_s:g}", one.title) for name, one in chosen]
    console.out.print()
    console.out.print(terminal.table("Training: ravenjax train FILE", ("file", "s", "what it trains"), rows))


def faults(hazard: str | None = None) -> None:
    """List the fault sites with their channels, the effects, the triggers and the library of hazards.

    Parameters
    ----------
    hazard
        Id of a hazard of the library: show all that is known of it instead.
    """
    from ravenjax import terminal
    from ravenjax.hazards import listing

    if hazard is not None:
        console.out.print(terminal.table(f"Hazard {hazard}", ("what", "is"), listing.description(hazard)))
        return
    from ravenjax.robot.sites import SITES
    from ravenjax.stages.faults.vocabulary import EFFECTS, TRIGGERS

    sites = []
    for site in SITES.values():
        kinds: dict[str, list[str]] = {}
        for channel in site.channels:
            kinds.setdefault(f"{channel.kind} {channel.unit}", []).append(channel.name)
        channels = "; ".join(f"{' '.join(names)} ({kind})" for kind, names in kinds.items())
        sites.append((site.layer, site.name, ("each arm: " if site.per_arm else "") + channels, site.where))
    columns = ("layer", "site", "channels (number, unit)", "where")
    console.out.print(terminal.table("Sites, in the robot's order", columns, sites))
    console.out.print()
    console.out.print(terminal.table("Effects", ("effect", "meaning"), list(EFFECTS.items())))
    console.out.print()
    console.out.print(terminal.table("Triggers", ("trigger", "start_ms counts"), list(TRIGGERS.items())))
    console.out.print()
    console.out.print(terminal.table("Hazards; `ravenjax faults ID` shows one", listing.COLUMNS, listing.table()))


def parameters(file: str | None = None, *, overrides: Overrides = None) -> None:
    """List the parameters that a campaign may vary, with the values that they have without it and their ranges.

    Parameters
    ----------
    file
        Campaign file; its software, arms and tools decide what there is. Without one: one arm, software raven2.
    """
    from ravenjax import paths, terminal
    from ravenjax.campaign import bounds, loading, plan

    plain = {"campaign": {"name": "plain"}, "group": [{"name": "plain"}]}
    given = overrides or ()
    config = loading.load(file, given) if file is not None else loading.from_dict(plain, overrides=given)
    program = plan.make(config.model_copy(update={"parameters": {}})).program
    values: dict[str, list[str]] = {}
    for path, value in paths.leaves(program.params, program.setup.arms):
        head, _, last = path.rpartition(".")
        key = head if last in paths.COMPONENTS else path
        values.setdefault(key, []).append(f"{float(value):g}")
    ranges = {path: bounds.of(path) for path in values}  # none: not a campaign's to vary
    rows = [
        (path, " ".join(values[path]), "; ".join(row.range for row in rows)) for path, rows in ranges.items() if rows
    ]
    console.out.print(terminal.table("Parameters", ("path", "value", "may be"), rows))
