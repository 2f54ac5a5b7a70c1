"""Describes hazards in words: rows of a list, and the full description of one hazard."""

from collections.abc import Iterator, Sequence
from typing import Any

from ravenjax.hazards import library
from ravenjax.hazards.library import Case, Hazard, Struck
from ravenjax.robots.raven2.declaration import SITES

COLUMNS = ("id", "layer", "title", "class", "runs")
"""Columns of `table`."""

LAYER_COLUMNS = ("layer", "what", "sites", "hazards")
"""Columns of `layers`."""


def hazard_table(hazards: Sequence[Hazard] | None = None) -> list[tuple[str, ...]]:
    """Return one row per hazard: id, layer, title, expected outcome class, and whether it can be
    simulated.

    hazards: None for all.
    """
    return [
        (
            row.id,
            row.layer,
            row.title,
            ", ".join(row.expected_class),
            "yes" if row.runnable else "documented only",
        )
        for row in (library.all_hazards() if hazards is None else hazards)
    ]


def of_layer(layer: str) -> list[Hazard]:
    """Return the hazards of a layer."""
    return [row for row in library.all_hazards() if row.layer == layer]


def of_site(site: str) -> list[Hazard]:
    """Return the hazards whose faults act at a site."""
    return [
        row
        for row in library.all_hazards()
        if any(slot.site == site for case in row.case for slot in case.fault)
    ]


def layer_table() -> list[tuple[str, ...]]:
    """Return one row per layer of the loop: description, sites, and number of hazards in the
    library.
    """
    return [
        (
            layer,
            what,
            ", ".join(site.name for site in SITES.values() if site.layer == layer) or "none",
            str(len(of_layer(layer))),
        )
        for layer, what in library.library_layers().items()
    ]


def describe_hazard(name: str) -> list[tuple[str, str]]:
    """Return (heading, text) for everything that the library states about one hazard.

    Raises UserError for an unknown id.
    """
    row = library.find_hazard(name)
    return [(what, text) for what, text in _lines(row) if text]


def _lines(row: Hazard) -> Iterator[tuple[str, str]]:
    words = library.library_terms()
    yield "id", row.id
    yield "title", row.title
    yield "layer", f"{row.layer}: {library.library_layers()[row.layer]}"
    yield "target", row.target
    yield "arm", row.arm or ""
    yield "hazard", "; ".join(f"{word}: {words['hazards'][word]}" for word in row.hazards)
    actions = words["unsafe_control_actions"]
    yield (
        "unsafe control action",
        "; ".join(f"{word}: {actions[word]}" for word in row.unsafe_control_actions),
    )
    yield "kind", row.kind
    yield "values", row.values
    yield "when", row.when
    yield "expected", row.expected
    yield (
        "outcome class",
        "; ".join(f"{word}: {words['classes'][word]}" for word in row.expected_class),
    )
    yield (
        "effect on the robot",
        f"{row.activated} of {row.injected} injections" if row.injected else "",
    )
    yield "clinical impact", row.impact
    yield "training scenario", ", ".join(row.scenarios)
    yield "source", row.source
    yield "note", row.note
    yield "departs from the published", row.departure
    yield "not run", row.documented_only
    for case in row.case:
        yield f"run {case.name}".strip(), _case(case)


def _case(case: Case) -> str:
    design = f"{case.design}, {case.runs} runs: " if case.runs else ""
    return design + "; ".join(_struck(fault) for fault in case.fault)


def _struck(struck: Struck) -> str:
    target = (
        f"{struck.site} {' + '.join(struck.along) if struck.along else ', '.join(struck.channels)}"
    )
    value = "" if struck.value is None else f" {_numbers(struck.value)} {struck.unit}"
    again = f", again every {_numbers(struck.every_ms)}" if struck.every_ms else ""
    period = f", period {_numbers(struck.period_ms)} ms" if struck.period_ms else ""
    window = (
        f"from {struck.trigger} {_numbers(struck.start_ms)} for"
        f" {_numbers(struck.duration_ms)}{again} ms"
    )
    return f"{struck.effect}{value}{period} at {target}, {window}"


def _numbers(value: Any) -> str:
    if isinstance(value, dict):
        (kind, numbers), *_ = value.items()
        return f"{kind} {_numbers(numbers)}"
    return (
        "{" + ", ".join(_numbers(item) for item in value) + "}"
        if isinstance(value, tuple)
        else f"{value}"
    )
