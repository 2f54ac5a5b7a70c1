"""A campaign's group that names hazards, as plain groups: one a case of each hazard.

    [[group]]
    name = "library"
    hazards = ["C09", "L7"]     # ids and layers, or "all": every hazard that the simulator can run
    start_ms = 1200             # optional, as arm, value, duration_ms: in place of the library's own

Groups without `hazards` stay as they are. The plain groups are checked like any other.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ravenjax.errors import UserError, shown, suggestion
from ravenjax.hazards import library
from ravenjax.hazards.library import Case, Hazard, Struck
from ravenjax.robot.sites import SITES

KEY = "hazards"
ALL = "all"
OVERRIDES = ("arm", "value", "start_ms", "duration_ms")
"""Keys of a fault that such a group may set for all its hazards."""
PASSED_ON = ("repeats", "parameters")
"""Keys of a group that each plain group inherits."""
_CROSSED = ("value", "start_ms", "duration_ms", "every_ms")
"""Keys of channels struck together: every combination, side by side in the slots."""


class WrongGroup(UserError):
    """A group that names hazards and cannot be expanded; `key` is where: of the group, or from `plain` of the file."""

    def __init__(self, key: str | tuple[str | int, ...], message: str) -> None:
        self.key, self.message = (key,) if isinstance(key, str) else key, message
        super().__init__(f"{self.key[-1]}: {message}")


def plain(raw: Mapping[str, Any]) -> tuple[dict[str, Any], list[int]]:
    """A campaign's tables with nothing but plain groups, and of each the number of the group that it was written as.

    What is no list of tables stays for others to refuse. Raises WrongGroup.
    """
    groups = raw.get("group")
    if not isinstance(groups, list) or not all(isinstance(group, Mapping) for group in groups):
        return dict(raw), []
    found, written = [], []
    for number, group in enumerate(groups):
        try:
            expanded = expand(group)
        except WrongGroup as error:
            raise WrongGroup(("group", number, *error.key), error.message) from None
        found += expanded
        written += [number] * len(expanded)
    return {**raw, "group": found}, written


def expand(group: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The plain groups of a raw table [[group]] of a campaign file. Raises WrongGroup.

    They are named GROUP/ID, or GROUP/ID-CASE where a hazard has several cases.
    """
    if KEY not in group:
        return [dict(group)]
    known = ("name", KEY, *OVERRIDES, *PASSED_ON)
    for key in group:
        if key not in known:
            expected = f"unknown key in a group that names hazards, expected one of {', '.join(known)}"
            raise WrongGroup(key, expected + suggestion(key, known))
    if not isinstance(group.get("name"), str):
        raise WrongGroup("name", "missing: names the group in tables and report")
    return [_group(group, hazard, case) for hazard in named(group[KEY]) for case in hazard.case]


def named(words: Any) -> list[Hazard]:
    """The hazards that ids, layers and "all" name, in the library's order. Raises WrongGroup."""
    listed = [words] if isinstance(words, str) else words
    if not isinstance(listed, Sequence) or not listed or not all(isinstance(word, str) for word in listed):
        raise WrongGroup(KEY, f'got {shown(words)}, expected ids and layers, such as ["C09", "L7"], or "all"')
    chosen = {row.id for word in listed for row in _meant(word)}
    return [row for row in library.rows() if row.id in chosen]


def _meant(word: str) -> list[Hazard]:
    runnable = [row for row in library.rows() if row.runnable]
    if word == ALL:
        return runnable
    if found := [row for row in runnable if word in (row.id, row.layer)]:
        return found
    for row in library.rows():
        if row.id == word:
            raise WrongGroup(KEY, f"{word} ({row.title}) cannot be run: {row.documented_only}")
    every = [*(row.id for row in runnable), *dict.fromkeys(row.layer for row in runnable), ALL]
    raise WrongGroup(KEY, f"unknown hazard {word!r}, expected an id, a layer or {ALL!r}{suggestion(word, every)}")


def _group(group: Mapping[str, Any], hazard: Hazard, case: Case) -> dict[str, Any]:
    name = f"{hazard.id}-{case.name}" if case.name else hazard.id
    overrides = {key: group[key] for key in OVERRIDES if key in group}
    _check(name, case, overrides)
    slots = [slot for struck in case.fault for slot in _slots(struck, overrides)]
    design = "zip" if case.fault[0].along else case.design
    table: dict[str, Any] = {"name": f"{group['name']}/{name}", "design": design, "fault": slots}
    if case.runs is not None:
        table["runs"] = case.runs
    return table | {key: group[key] for key in PASSED_ON if key in group}


def _check(name: str, case: Case, overrides: Mapping[str, Any]) -> None:
    """WrongGroup for an override that would tear apart what a case strikes together."""
    first, *others = case.fault
    if "value" in overrides:
        if others:
            raise WrongGroup("value", f"{name} strikes {len(case.fault)} channels, each with a value of its own")
        if not library.takes_value(first.effect):
            raise WrongGroup("value", f"{name} has effect {first.effect!r}, which takes none")
    for key, value in overrides.items():
        if value == []:
            raise WrongGroup(key, f"{name}: the list is empty, expected at least one value")
        if (others or first.along) and isinstance(value, dict):
            raise WrongGroup(key, f"{name} strikes several channels at once, expected numbers, got {shown(value)}")
        if others and isinstance(value, list) and key != "arm":
            raise WrongGroup(key, f"{name} strikes several channels at once, expected one number, got {shown(value)}")


def _slots(struck: Struck, overrides: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """[[group.fault]] tables of one slot of the library."""
    table = struck.model_dump(exclude={"along", "unit"}, exclude_none=True, exclude_defaults=True, mode="json")
    if not SITES[struck.site].per_arm:
        overrides = {key: value for key, value in overrides.items() if key != "arm"}
    table |= overrides
    if struck.along is None:
        yield table
        return
    keys = [key for key in _CROSSED if key in table]
    rows = itertools.product(*(_listed(table[key]) for key in keys))
    crossed = dict(zip(keys, map(list, zip(*rows, strict=True)), strict=True))
    for name, share in struck.along.items():
        whole = SITES[struck.site].channel(name).kind != "float"
        values = [share * value for value in crossed["value"]]
        yield table | crossed | {"channel": name, "value": [int(v) for v in values] if whole else values}


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]
