"""Checks that the parameters in a campaign file lie within the ranges that the robot declares.

The check imports the modules of the robot's tick, which is slow. Parameters are therefore checked
when the campaign is planned, not when its file is read.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.location import Complaint, Key
from ravenjax.errors import format_value, suggest_name
from ravenjax.numbers import paths, quantity
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.setup import CAMPAIGN, Injection
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import Channel, Field

if TYPE_CHECKING:
    from ravenjax.campaign.file.config import CampaignConfig


@functools.cache
def parameter_bounds(robot: Robot) -> tuple[tuple[str, Quantity], ...]:
    """Return (path, allowed values) of each parameter of a robot, in order.

    Paths have the form of `shorten_path`. Joints with different ranges have several entries.
    """
    return tuple(quantity.list_quantities(robot.part("campaign").Params))


@functools.cache
def _reserved(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Return (path or beginning of paths, reason) of parameters that a campaign must not vary.

    Longer paths are first.
    """
    rows_of = quantity.list_reserved(robot.part("campaign").Params)
    return tuple(sorted(rows_of, key=lambda row: len(row[0]), reverse=True))


def shorten_path(robot: Robot, path: str) -> str:
    """Return a parameter's path without the arm, numbers, the joint and the axis."""
    return paths.plain_path(path, robot.arms, robot.joints)


Ranges = tuple[tuple[str, Quantity], ...]
"""(path without arm and joint, allowed values) of parameters."""


def allowed_values(robot: Robot, path: str, more: Ranges = ()) -> list[Quantity]:
    """Return the allowed values of the parameter at `path`.

    There are several entries if `path` names a vector with different ranges. more: parameters that
    the campaign adds to those of its robot.
    """
    kind, last = shorten_path(robot, path), path.rpartition(".")[2]
    rows = [row for name, row in (*parameter_bounds(robot), *more) if name == kind]
    return [row for row in rows if last in row.joints or not row.joints or last not in robot.joints]


def reserved_reason(robot: Robot, path: str) -> str:
    """Return why a campaign must not vary a parameter, and what to write instead; "" if it may."""
    kind = shorten_path(robot, path)
    for name, why in _reserved(robot):
        if kind == name or kind.startswith(f"{name}."):
            return f"cannot be set: {why}"
    return ""


@functools.cache
def changeable_parameters(model: Any, robot: Robot, arms: tuple[str, ...]) -> list[str]:
    """Return the paths of the parameters that a fault can change.

    model: the robot's subclass of `CampaignConfig`.
    """
    campaign = {"name": "usual", "robot": robot.name, "arms": arms, "duration_s": 0.1}
    config = model.model_validate({"campaign": campaign, "group": [{"name": "usual"}]})
    usual = robot.part("campaign").prepare(config, {}, Injection(), CAMPAIGN)
    return [
        path
        for path, _ in paths.path_leaves(usual.params, usual.setup)
        if re.match(model.changeable, path) and allowed_values(robot, path)
    ]


def parameter_channel(robot: Robot, known: list[str], name: str) -> tuple[Channel, str]:
    """Return the channel of a parameter for faults, and why none can act on it; "" if one can.

    known: parameters that a fault can change.
    """
    if name not in known:
        parts = ", ".join(dict.fromkeys(path.partition(".")[0] for path in known))
        return Channel(name, (), "float", "1"), (
            f"{name} cannot change during a run: expected the whole path of one number that is read"
            f" in every tick, of {parts}{suggest_name(name, known)}"
        )
    row = allowed_values(robot, name)[0]
    limits = Field(row.low, row.high, f"a parameter ({row.meaning})", 32)
    return Channel(name, (), "int32" if row.whole else "float", row.unit, limits), ""


def find_invalid_values(config: CampaignConfig) -> Iterator[Complaint]:
    """Yield (key, message) of each parameter value that is out of range. Paths are not checked."""
    first: dict[str, Key] = {}
    more = config.own_ranges
    for key, table in config.parameter_tables():
        for path, axis in table.items():
            first.setdefault(path, (*key, path))
            wrong = [reserved_reason(config.robot, path), config.unread(path)]
            wrong += [out_of_range(axis, row) for row in allowed_values(config.robot, path, more)]
            if key[-1] == "cross" and any(path in table for table in _beside(config, key)):
                wrong.append("the path is in [parameters], too: remove one of the two")
            yield from (((*key, path), message) for message in wrong if message)
    for path, other in itertools.combinations(first, 2):
        if paths_overlap(config.robot, path, other):
            message = f"names the same numbers as {path}: use only one of these paths in the file"
            yield first[other], message


def find_invalid_paths(config: CampaignConfig, known: Iterable[str]) -> Iterator[Complaint]:
    """Yield (key, message) of each unknown path, and of each list that looks like a vector."""
    known = list(known)
    for key, table in config.parameter_tables():
        for path, axis in table.items():
            if message := _unfit(config, path, axis, known):
                yield (*key, path), message


def _beside(config: CampaignConfig, key: Key) -> Iterator[dict[str, Axis]]:
    """Yield the tables of parameters that apply together with a table of crossed parameters."""
    yield config.parameters
    for number, group in enumerate(config.group):
        if key[1:2] in ((), (number,)):
            yield group.parameters


def _unfit(config: CampaignConfig, path: str, axis: Axis, known: list[str]) -> str:
    # Returns why a parameter cannot take these values; "" if it can.
    robot = config.robot
    if path not in known:
        part = path.partition(".")[0]
        if allowed_values(robot, path) and not any(name.startswith(f"{part}.") for name in known):
            return (
                f"unknown parameter: this campaign has no {part!r}. Add the section of the file to"
                " which the parameter belongs"
            )
        free = [name for name in known if not (reserved_reason(robot, name) or config.unread(name))]
        return f"unknown parameter{suggest_name(path, free)}"
    parts = [name.rpartition(".")[2] for name in known if name.rpartition(".")[0] == path]
    parts = [part for part in parts if part in paths.path_words(robot.joints)]
    if axis.kind != "list" or axis.explicit or len(axis.values) != len(parts):
        return ""
    pairs = zip(parts, axis.values, strict=True)
    return (
        f"got a list of {len(parts)} for a vector of {len(parts)} numbers, which has two possible"
        " meanings. For one number per joint or axis, write"
        f" {', '.join(f'{path}.{p} = {v:g}' for p, v in pairs)}. For {len(parts)} values, each for"
        f" the whole vector, write {{ list = {format_value(list(axis.values))} }}"
    )


def out_of_range(axis: Axis, row: Quantity) -> str:
    """Return a message if values of a parameter are out of range, else ""."""
    if row.whole and axis.drawn and not axis.listed:
        return f"{axis.kind} may draw fractions, expected {row}; write {{choice = [..]}}"
    law = f"{axis.kind} = {format_value(list(axis.values))}"
    drawn = "" if axis.listed else f"{law}, which may draw "
    for value in axis.listed or axis.extent:
        if not row.low <= value <= row.high or (row.whole and value != int(value)):
            return f"got {drawn}{format_value(value)}, expected {row}"
    return ""


def paths_overlap(robot: Robot, path: str, other: str) -> bool:
    """Return whether two different paths of parameters name the same number."""
    components = paths.path_words(robot.joints)

    def marks(path: str) -> list[list[str]]:
        """Return arm, numbers and component of a path; a missing part means all of them."""
        parts = path.split(".")
        arms, numbers = [p for p in parts if p in robot.arms], [p for p in parts if p.isdecimal()]
        return [arms, numbers, [p for p in parts[-1:] if p in components]]

    return shorten_path(robot, path) == shorten_path(robot, other) and all(
        not a or not b or a == b for a, b in zip(marks(path), marks(other), strict=True)
    )
