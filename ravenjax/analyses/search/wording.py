"""Writes the names, inputs and cases of a search as text for its report."""

import re
from collections.abc import Mapping, Sequence
from typing import Any


def short_axis_name(name: str) -> str:
    """Return a short name of an axis: a fault's field ("value (fault 1)") or a parameter's path."""
    match = re.fullmatch(r"fault(\d+)_(\w+?)(_ms)?", name)
    if match is None:
        return name
    # Fault 0, the first one, is not numbered.
    number = f" (fault {match[1]})" if int(match[1]) else ""
    unit = ", ms" if match[3] else ""
    return f"{match[2]}{number}{unit}"


def describe_inputs(inputs: Sequence[Mapping[str, Any]]) -> str:
    """Return the inputs of `Template.describe_inputs` and their distributions as text."""
    parts = []
    for values in inputs:
        # `drawn` is a table with one key, such as {"uniform": [-2000, 2000]}.
        kind, numbers = next(iter(values["drawn"].items()))
        unit = f" {values['unit']}" if values["unit"] else ""
        text = ", ".join(f"{number:g}" for number in numbers)
        parts.append(f"{short_axis_name(values['name'])}: {kind} {text}{unit}")
    return "; ".join(parts)


def describe_case(case: Mapping[str, Any]) -> str:
    """Return a case as text such as "duration 8 ms". case: axis name -> value of the axis."""
    parts = []
    for axis, value in case.items():
        name, _, unit = short_axis_name(axis).partition(", ")
        # A duration may be the word "end" instead of a number: until the run ends.
        has_unit = unit and value != "end"
        parts.append(f"{name} {value} {unit}" if has_unit else f"{name} {value}")
    return ", ".join(parts)


def group_series(
    records: list[dict[str, Any]], along: str
) -> dict[tuple[tuple[str, Any], ...], list[dict[str, Any]]]:
    """Return the records in groups. The cells of a group differ only in their value of `along`. A
    group's key consists of (name, value) of each value in which its cells are equal.
    """
    groups: dict[tuple[tuple[str, Any], ...], list[dict[str, Any]]] = {}
    for record in records:
        others = tuple((key, value) for key, value in record["cell"].items() if key != along)
        groups.setdefault(others, []).append(record)
    return groups
