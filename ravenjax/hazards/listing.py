"""Describes hazards as text, in a table or in full."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ravenjax import robots
from ravenjax.bundled import resources
from ravenjax.hazards import library
from ravenjax.hazards.library import Hazard, Struck
from ravenjax.vocabulary.robot import Robot

COLUMNS = ("id", "layer", "title", "class", "runs")
"""Columns of `hazard_table`."""

LAYER_COLUMNS = ("layer", "what", "sites", "hazards")
"""Columns of `layer_table`."""


def hazard_table(hazards: Sequence[Hazard]) -> list[tuple[str, ...]]:
    """Return one row per hazard: id, layer, title, expected class, whether it can be simulated."""
    return [
        (
            row.id,
            row.layer,
            row.title,
            ", ".join(row.expected_class),
            "yes" if row.runnable else "documented only",
        )
        for row in hazards
    ]


def of_layer(layer: str, robot: Robot) -> list[Hazard]:
    """Return the hazards of a layer."""
    return [row for row in library.all_hazards(robot) if row.layer == layer]


def of_site(site: str, robot: Robot) -> list[Hazard]:
    """Return the hazards whose faults act at a site."""
    return [
        row
        for row in library.all_hazards(robot)
        if any(slot.site == site for case in row.case for slot in case.fault)
    ]


def layer_table(robot: Robot = robots.USUAL) -> list[tuple[str, ...]]:
    """Return one row per layer of the loop: name, description, sites, and number of hazards."""
    return [
        (
            layer,
            what,
            ", ".join(site.name for site in robot.sites.values() if site.layer == layer) or "none",
            str(len(of_layer(layer, robot))),
        )
        for layer, what in library.library_layers(robot).items()
    ]


def describe_hazard(name: str, robot: Robot) -> list[tuple[str, str]]:
    """Return (heading, text) for each property of a hazard in the library.

    Raise UserError for an unknown id.
    """
    rows = resources.render_rows(
        Path(__file__).with_suffix(".j2"),
        row=library.find_hazard(name, robot),
        terms=library.library_terms(),
        layers=library.library_layers(robot),
        struck=_struck,
    )
    return [row for row in rows if row[1]]


def _struck(struck: Struck) -> str:
    # Describes a fault as text: effect, value, site, start and duration.
    channels = " + ".join(struck.along) if struck.along else ", ".join(struck.channels)
    value = "" if struck.value is None else f" {_numbers(struck.value)} {struck.unit}"
    again = f", again every {_numbers(struck.every_ms)}" if struck.every_ms else ""
    period = f", period {_numbers(struck.period_ms)} ms" if struck.period_ms else ""
    window = (
        f"from {struck.trigger} {_numbers(struck.start_ms)} for"
        f" {_numbers(struck.duration_ms)}{again} ms"
    )
    return f"{struck.effect}{value}{period} at {struck.site} {channels}, {window}"


def _numbers(value: Any) -> str:
    if isinstance(value, dict):
        ((kind, numbers),) = value.items()
        return f"{kind} {_numbers(numbers)}"
    return f"{{{', '.join(map(_numbers, value))}}}" if isinstance(value, tuple) else f"{value}"
