"""Describes hazards as text, in a table or in full."""

from collections.abc import Sequence
from pathlib import Path

from ravenjax import resources
from ravenjax.hazards import library
from ravenjax.hazards.library import Hazard, LibraryFault
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


def list_hazards_of_layer(layer: str, robot: Robot) -> list[Hazard]:
    """Return the hazards of a layer."""
    return [row for row in library.all_hazards(robot) if row.layer == layer]


def list_hazards_of_site(site: str, robot: Robot) -> list[Hazard]:
    """Return the hazards whose faults act at a site."""
    return [
        row
        for row in library.all_hazards(robot)
        if any(slot.site == site for case in row.case for slot in case.fault)
    ]


def layer_table(robot: Robot) -> list[tuple[str, ...]]:
    """Return one row per layer of the loop: name, description, sites, and number of hazards."""
    return [
        (
            layer,
            what,
            ", ".join(site.name for site in robot.sites.values() if site.layer == layer) or "none",
            str(len(list_hazards_of_layer(layer, robot))),
        )
        for layer, what in library.library_layers(robot).items()
    ]


def describe_hazard(name: str, robot: Robot) -> list[tuple[str, str]]:
    """Return (heading, text) for each property of a hazard in the library. Raise UserError for an
    unknown id.
    """
    rows = resources.render_rows(
        Path(__file__).with_suffix(".j2"),
        row=library.find_hazard(name, robot),
        terms=library.library_terms(),
        layers=library.library_layers(robot),
        describe_fault=_describe_fault,
    )
    return [row for row in rows if row[1]]


def _describe_fault(fault: LibraryFault) -> str:
    # Describes a fault as text: effect, value, site, start and duration.
    channels = " + ".join(fault.along) if fault.along else ", ".join(fault.channels)
    value = "" if fault.value is None else f" {_format_numbers(fault.value)} {fault.unit}"
    again = f", again every {_format_numbers(fault.every_ms)}" if fault.every_ms else ""
    period = f", period {_format_numbers(fault.period_ms)} ms" if fault.period_ms else ""
    window = (
        f"from {fault.trigger} {_format_numbers(fault.start_ms)} for"
        f" {_format_numbers(fault.duration_ms)}{again} ms"
    )
    return f"{fault.effect}{value}{period} at {fault.site} {channels}, {window}"


def _format_numbers(value) -> str:
    # Formats a number, a list in braces, or a distribution by its name and numbers.
    if isinstance(value, dict):
        ((kind, numbers),) = value.items()
        return f"{kind} {_format_numbers(numbers)}"
    is_list = isinstance(value, tuple)
    return f"{{{', '.join(map(_format_numbers, value))}}}" if is_list else f"{value}"
