"""Checks that the parameters in a campaign file lie within the ranges that the robot declares.

The check imports the modules of the robot's tick, which is slow. Parameters are therefore checked
when the campaign is planned, not when its file is read.
"""

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
    """Return (path, allowed values) of each parameter of a robot, in order. Paths have the form of
    `shorten_path`. Joints with different ranges have several entries.
    """
    return tuple(quantity.list_quantities(robot.part("campaign").Params))


@functools.cache
def _reserved(robot: Robot) -> tuple[tuple[str, str], ...]:
    # Returns (path or beginning of paths, reason) of parameters that a campaign must not vary.
    # Longer paths are first, because their reasons have precedence.
    rows = quantity.list_reserved(robot.part("campaign").Params)
    return tuple(sorted(rows, key=lambda row: len(row[0]), reverse=True))


def shorten_path(robot: Robot, path: str) -> str:
    """Return a parameter's path without its arm, indices, joint and axis."""
    return paths.plain_path(path, robot.arms, robot.joints)


Ranges = tuple[tuple[str, Quantity], ...]
"""(path without arm and joint, allowed values) of parameters."""


def allowed_values(robot: Robot, path: str, added: Ranges = ()) -> list[Quantity]:
    """Return the allowed values of the parameter at `path`, [] if there is no such parameter. There
    are several entries if `path` names a vector whose joints have different ranges. added:
    parameters that the campaign adds to the parameters of its robot.
    """
    short_path = shorten_path(robot, path)
    rows = [row for name, row in (*parameter_bounds(robot), *added) if name == short_path]
    last = path.rpartition(".")[2]
    if last not in robot.joints:
        return rows
    # The path names one joint. A row without names of joints applies to all joints.
    return [row for row in rows if last in row.joints or not row.joints]


def reserved_reason(robot: Robot, path: str) -> str:
    """Return why a campaign must not vary a parameter, and what to write instead; "" if it may."""
    short_path = shorten_path(robot, path)
    for name, reason in _reserved(robot):
        if short_path == name or short_path.startswith(f"{name}."):
            return f"cannot be set: {reason}"
    return ""


@functools.cache
def changeable_parameters(model: Any, robot: Robot, arms: tuple[str, ...]) -> list[str]:
    """Return the paths of parameters that a fault can change. model: the robot's subclass of
    `CampaignConfig`, whose pattern `changeable` matches the beginnings of these paths.
    """
    # A short campaign without faults has all parameters of the robot.
    campaign = {"name": "short", "robot": robot.name, "arms": arms, "duration_s": 0.1}
    config = model.model_validate({"campaign": campaign, "group": [{"name": "fault_free"}]})
    prepared = robot.part("campaign").prepare(config, {}, Injection(), CAMPAIGN)
    return [
        path
        for path, _ in paths.path_leaves(prepared.params, prepared.setup)
        if re.match(model.changeable, path) and allowed_values(robot, path)
    ]


@functools.cache
def parameter_channel(
    model: Any, robot: Robot, arms: tuple[str, ...], name: str
) -> tuple[Channel, str]:
    """Return the fault channel (type, unit, range) of the parameter with the path `name`, and the
    reason why no fault can change the parameter; "" if a fault can. model: the robot's subclass of
    `CampaignConfig`.
    """
    changeable = changeable_parameters(model, robot, arms)
    if name not in changeable:
        parts = ", ".join(dict.fromkeys(path.partition(".")[0] for path in changeable))
        # The caller needs a channel, although it is not used.
        return Channel(name, (), "float", "1"), (
            f"{name} cannot change during a run: expected the whole path of one number that is read"
            f" in every tick, of {parts}{suggest_name(name, changeable)}"
        )
    # A path of one number has one entry.
    row = allowed_values(robot, name)[0]
    limits = Field(row.low, row.high, f"a parameter ({row.meaning})", 32)
    return Channel(name, (), "int32" if row.whole else "float", row.unit, limits), ""


def _unread(config: "CampaignConfig", path: str) -> str:
    # Returns why the parameter at `path` has no effect in this campaign; "" if it has one.
    if path in config.without_effect:
        return f"has no effect: {config.without_effect[path]}"
    for rule in allowed_values(config.robot, path):
        # The robot reads some parameters only if a key of [campaign] has a certain value.
        key, value = rule.read_when or ("", "")
        if key and getattr(config.campaign, key) != value:
            return (
                f"has an effect only with {key} = {value!r}: remove this parameter, or set {key} in"
                " [campaign]"
            )
    return ""


def find_invalid_values(config: "CampaignConfig") -> Iterator[Complaint]:
    """Yield (key, message) of each parameter that a fault cannot change, and of each value that is
    out of range. Unknown paths in tables of parameters are left to `find_invalid_paths`.
    """
    for g, slot, name in dict.fromkeys(config.faulty_parameters()):
        _, reason = config.parameter_channel(name)
        if message := reason or _unread(config, name):
            yield ("group", g, "fault", slot, "channel"), message
    # The key at which the file first has each path.
    first_keys: dict[str, Key] = {}
    added = config.own_ranges
    for key, table in config.parameter_tables():
        for path, axis in table.items():
            first_keys.setdefault(path, (*key, path))
            # A check that finds no mistake returns "".
            messages = [reserved_reason(config.robot, path), _unread(config, path)]
            rules = allowed_values(config.robot, path, added)
            messages += [out_of_range(axis, rule) for rule in rules]
            if key[-1] == "cross":
                # The key is ("cross",), which applies to all groups, or ("group", g, "cross").
                groups = [group for g, group in enumerate(config.group) if key[1:2] in ((), (g,))]
                if any(path in owner.parameters for owner in (config, *groups)):
                    messages.append("the path is in [parameters], too: remove one of the two")
            yield from (((*key, path), message) for message in messages if message)
    for path, other in itertools.combinations(first_keys, 2):
        if paths_overlap(config.robot, path, other):
            message = f"names the same numbers as {path}: use only one of these paths in the file"
            yield first_keys[other], message


def find_invalid_paths(config: "CampaignConfig", known: Iterable[str]) -> Iterator[Complaint]:
    """Yield (key, message) of each unknown path, and of each list that seems to mean a vector."""
    known = list(known)
    for key, table in config.parameter_tables():
        for path, axis in table.items():
            if message := _find_path_error(config, path, axis, known):
                yield (*key, path), message


def _find_path_error(config: "CampaignConfig", path: str, axis: Axis, known: list[str]) -> str:
    # Returns an error message if a path is unknown, or if a list looks like a vector; else "".
    # known: all paths that the campaign may vary.
    robot = config.robot
    if path not in known:
        part = path.partition(".")[0]
        # The robot has the parameter, but only with a section that this campaign does not have.
        if allowed_values(robot, path) and not any(name.startswith(f"{part}.") for name in known):
            return (
                f"unknown parameter: this campaign has no {part!r}. Add the section of the file to"
                " which the parameter belongs"
            )
        settable = [
            name for name in known if not (reserved_reason(robot, name) or _unread(config, name))
        ]
        return f"unknown parameter{suggest_name(path, settable)}"
    # If `path` names a vector: its joints or axes, which are the last words of longer known paths.
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
    """Return a message if values of a parameter are out of range, else "". row: allowed values."""
    if row.whole and axis.drawn and not axis.listed:
        return f"{axis.kind} may draw fractions, expected {row}; write {{choice = [..]}}"
    distribution = f"{axis.kind} = {format_value(list(axis.values))}"
    drawn = "" if axis.listed else f"{distribution}, which may draw "
    for value in axis.listed or axis.extent:
        if not row.low <= value <= row.high or (row.whole and value != int(value)):
            return f"got {drawn}{format_value(value)}, expected {row}"
    return ""


def paths_overlap(robot: Robot, path: str, other: str) -> bool:
    """Return whether two different paths of parameters have at least one number in common."""
    joints_and_axes = paths.path_words(robot.joints)

    def split_path(path: str) -> list[list[str]]:
        # Returns [arm], [indices] and [joint or axis] of a path. An empty list means all of them.
        parts = path.split(".")
        arm = [part for part in parts if part in robot.arms]
        indices = [part for part in parts if part.isdecimal()]
        return [arm, indices, [part for part in parts[-1:] if part in joints_and_axes]]

    return shorten_path(robot, path) == shorten_path(robot, other) and all(
        not words or not other_words or words == other_words
        for words, other_words in zip(split_path(path), split_path(other), strict=True)
    )
