"""Writes the names, inputs and cases of a search as text for its report."""

import re
from collections.abc import Mapping, Sequence
from typing import Any


def short_axis_name(name: str) -> str:
    """Return a short name of an axis: a fault's field ("value (fault 1)") or a parameter's path."""
    match = re.fullmatch(r"fault(\d+)_(\w+?)(_ms)?", name)
    if match is None:
        return name
    which = f" (fault {match[1]})" if int(match[1]) else ""
    return match[2] + which + (", ms" if match[3] else "")


def describe_inputs(inputs: Sequence[Mapping[str, Any]]) -> str:
    """Return the inputs and their distributions as text. `inputs`: value of `Template.drawn`."""
    parts = []
    for one in inputs:
        kind, values = next(iter(one["drawn"].items()))
        unit = f" {one['unit']}" if one["unit"] else ""
        parts.append(
            f"{short_axis_name(one['name'])}: {kind} {', '.join(f'{v:g}' for v in values)}{unit}"
        )
    return "; ".join(parts)


def describe_case(case: Mapping[str, Any]) -> str:
    """Return a case, given as values by axis name, as text for tables."""
    parts = ((*short_axis_name(name).partition(", "), value) for name, value in case.items())
    return ", ".join(
        f"{name} {value}" + (f" {unit}" if value != "end" and unit else "")
        for name, _, unit, value in parts
    )


def group_series(
    records: list[dict[str, Any]], along: str
) -> dict[tuple[tuple[str, Any], ...], list[dict[str, Any]]]:
    """Group records by everything except `along`."""
    groups: dict[tuple[tuple[str, Any], ...], list[dict[str, Any]]] = {}
    for record in records:
        others = tuple((key, value) for key, value in record["cell"].items() if key != along)
        groups.setdefault(others, []).append(record)
    return groups
