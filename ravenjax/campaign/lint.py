"""Keys of a campaign that nothing would read, or that would only make copies of the same run.

Each of them is a slip: whoever writes three values for an effect that takes none expects three
different runs.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from ravenjax.campaign.faults import design, sampling
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import PHASE, Axis
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import SAMPLED, Fault, Group
from ravenjax.campaign.file.location import Complaint, Key
from ravenjax.campaign.file.semantics import ALL, last_start, parameter_tables, random_in_itself
from ravenjax.errors import shown
from ravenjax.hazards.naming import hazards_of
from ravenjax.numbers import paths
from ravenjax.vocabulary.effects import NETWORK_EFFECTS, WITHOUT_VALUE
from ravenjax.vocabulary.robot import Robot


def complaints(config: CampaignConfig) -> Iterator[Complaint]:
    """(key, message) of every such key of a config whose words are right; see `drawn_once` for
    one more kind.
    """
    for g, group in enumerate(config.group):
        yield from _group(config, group, ("group", g))
    yield from _parameters(config)
    yield from _observers(config)


def drawn_once(config: CampaignConfig) -> Iterator[Complaint]:
    """(key, message) of each distribution from which only one number would be drawn: its group
    makes one run.

    A robot that is drawn anew for each hazard of the library is left alone.
    """
    single = [
        g
        for g, group in enumerate(config.group)
        if group.design not in SAMPLED and _draws(config, group) == 1
    ]
    for g in single:
        group = config.group[g]
        axes = {
            ("fault", f, name): axis
            for f, fault in enumerate(group.fault)
            for name, axis in _axes(fault)
        }
        if not (group.fault and hazards_of(group.name)):
            axes |= {("parameters", path): axis for path, axis in group.parameters.items()}
        for key, axis in axes.items():
            if axis.drawn:
                yield ("group", g, *key), _once(axis, "the group makes one run")
    if single and len(config.group) == 1:
        for path, axis in config.parameters.items():
            if axis.drawn and path not in config.group[0].parameters:
                yield ("parameters", path), _once(axis, "the campaign makes one run")


def notices(config: CampaignConfig) -> Iterator[Complaint]:
    """(key, message) of what is accepted and may yet not be what was meant."""
    for key, table in parameter_tables(config):
        for path, axis in table.items():
            if (
                bounds.plain(config.robot, path) in config.robot.noise
                and not config.campaign.noise
                and axis.values != (0,)
            ):
                yield (
                    (*key, path),
                    (
                        "nothing reads it while campaign.noise is off; set campaign.noise = true to"
                        " use it"
                    ),
                )
    for g, group in enumerate(config.group):
        for f, fault in enumerate(group.fault if hazards_of(group.name) else ()):
            yield from _late(config, fault, ("group", g, "fault", f))


def _draws(config: CampaignConfig, group: Group) -> int:
    """Runs of a group that draw for themselves."""
    return group.repeats * sum(
        sampling.count(group, axes) for _, axes in design.faults_and_axes(config, group)
    )


def _once(axis: Axis, why: str) -> str:
    return (
        f"{axis.kind} = {shown(list(axis.values))} is drawn from once, for {why}. For more draws"
        ' write design = "random" (or "lhs", "sobol") and runs = 100 in the group; for one run'
        " write the value itself"
    )


def _group(config: CampaignConfig, group: Group, key: Key) -> Iterator[Complaint]:
    gridded = group.design in ("grid", "list")
    for f, fault in enumerate(group.fault):
        yield from _fault(config.robot, fault, (*key, "fault", f), gridded)
        if not hazards_of(group.name):
            yield from _late(config, fault, (*key, "fault", f))
        if group.design != "zip":
            for name, axis in _axes(fault):
                yield from _twice(config.robot, (*key, "fault", f, name), axis)
    if group.design != "zip":
        for path, axis in group.parameters.items():
            yield from _twice(config.robot, (*key, "parameters", path), axis)
    for path, axis in group.cross.items():
        yield from _twice(config.robot, (*key, "cross", path), axis)
    for r, run in enumerate(group.run):
        if (first := group.run.index(run)) != r:
            yield (
                (*key, "run", r),
                f"the same as run[{first}]: its runs would be identical, remove it",
            )
    if group.design in SAMPLED and (group.runs or 0) > 1 and not _differ(config, group):
        yield (
            (*key, "runs"),
            (
                f"the {group.runs} runs would be identical: nothing in the group is drawn. Give a"
                " key a list or a distribution, or remove design and runs"
            ),
        )


def _differ(config: CampaignConfig, group: Group) -> bool:
    """Whether anything differs between the runs of a sampled group."""
    axes = [axis for fault in group.fault for _, axis in _axes(fault)]
    axes += {**config.parameters, **group.parameters}.values()
    every = any(
        fault.channel is not None and fault.channel.listed == (ALL,) for fault in group.fault
    )
    return every or random_in_itself(config, group) or any(map(_varies, axes))


def _varies(axis: Axis) -> bool:
    if axis.kind == "normal":
        return axis.values[1] > 0
    return axis.kind == PHASE or len(set(axis.values)) > 1


def _axes(fault: Fault) -> Iterator[tuple[str, Axis]]:
    for name in Fault.model_fields:
        if isinstance(axis := getattr(fault, name), Axis):
            yield name, axis


def _twice(robot: Robot, key: Key, axis: Axis) -> Iterator[Complaint]:
    """A list that holds a value twice; one that is drawn from says `choice`."""
    if axis.kind != "list":
        return
    value, times = Counter(axis.values).most_common(1)[0]
    if times > 1:
        how = "twice" if times == 2 else f"{times} times"
        path = str(key[-1])
        names, first = (
            paths.components(robot.joints),
            paths.component_names(len(axis.values), robot.joints, robot.leading_joints)[0],
        )
        vector = "." in path and first in names and path.rpartition(".")[2] not in names
        hint = (
            f"; for the numbers of a vector write one path each, such as {path}.{first}"
            if vector
            else ""
        )
        yield (
            key,
            (
                f"got {shown(value)} {how}: its runs would be identical. Write each value once; for"
                " repeats of a random run write repeats, to draw a value more often write {"
                f" choice = [..] }}{hint}"
            ),
        )


def _fault(robot: Robot, fault: Fault, key: Key, gridded: bool) -> Iterator[Complaint]:
    effects, channels = fault.effect.listed, () if fault.channel is None else fault.channel.listed
    if channels == (ALL,):
        channels = tuple(channel.name for channel in robot.sites[fault.site].channels)
    period = None if fault.period_ms.values == (0,) else fault.period_ms
    # keys that only some effects read: name, what the file gives, which effects do not, and why
    for name, axis, idle, why in (
        ("value", fault.value, [e for e in effects if e in WITHOUT_VALUE], "takes no value"),
        ("period_ms", period, [e for e in effects if e != "periodic"], "has no period"),
    ):
        if axis is None or not idle:
            continue
        if len(idle) == len(effects):
            yield (*key, name), f"effect {idle[0]!r} {why}: remove the key"
        elif gridded and axis.kind == "list" and len(axis.values) > 1:
            yield (*key, "effect"), _once_for_each(idle[0], why, name)
    bound = {effect: NETWORK_EFFECTS[effect][0] for effect in effects if effect in NETWORK_EFFECTS}
    if not channels or not bound:
        return
    effect, acts = next(iter(bound.items()))
    if len(bound) == len(effects):
        if set(channels) != set(bound.values()):
            yield (*key, "channel"), f"effect {effect!r} acts on {acts!r} by itself: remove the key"
    elif gridded and len(channels) > 1:
        yield (*key, "effect"), _once_for_each(effect, f"acts on {acts!r} by itself", "channel")


def _late(config: CampaignConfig, fault: Fault, key: Key) -> Iterator[Complaint]:
    """An onset that may be drawn after the end of the run."""
    start, last = fault.start_ms, last_start(config, fault, key)
    if start.kind in ("uniform", "loguniform") and start.values[1] > last:
        low, high = start.values
        yield (
            (*key, "start_ms"),
            (
                f"got {start.kind} = [{low:g}, {high:g}], expected at most {last}: what is drawn"
                " beyond would never strike; write an earlier end, or a longer campaign.duration_s"
            ),
        )


def _once_for_each(effect: str, why: str, name: str) -> str:
    return (
        f"effect {effect!r} {why}, and a grid would run it once for each {name}, all alike: give it"
        " a [[group]] of its own"
    )


def _parameters(config: CampaignConfig) -> Iterator[Complaint]:
    if any(group.design != "zip" for group in config.group):
        for path, axis in config.parameters.items():
            yield from _twice(config.robot, ("parameters", path), axis)
    for path, axis in config.cross.items():
        yield from _twice(config.robot, ("cross", path), axis)
    for key, table in parameter_tables(config):
        for path in table:
            if why := config.unread(path):
                yield (*key, path), why
    yield from _crossed_too(config)
    yield from _overlapping(config)


def _crossed_too(config: CampaignConfig) -> Iterator[Complaint]:
    """Crossed parameters that [parameters] has as well."""
    for g, group in enumerate(config.group):
        plain: Mapping[str, Any] = {**config.parameters, **group.parameters}
        for path in {**config.cross, **group.cross}:
            if path in plain:
                key: Key = ("group", g, "cross", path) if path in group.cross else ("cross", path)
                yield (
                    key,
                    (
                        "stands in parameters, too, where cross would replace it: remove one of"
                        " the two"
                    ),
                )


def _overlapping(config: CampaignConfig) -> Iterator[Complaint]:
    """Two paths of one number: a run that has the one only would get the robot's own value by
    the other.
    """
    where: dict[str, Key] = {}
    for key, table in parameter_tables(config):
        for path in table:
            where.setdefault(path, (*key, path))
    for one, other in itertools.combinations(where, 2):
        if overlap(config.robot, one, other):
            yield (
                where[other],
                (
                    f"names numbers that {one} names, too: write one of the two paths throughout"
                    " the file"
                ),
            )


def overlap(robot: Robot, one: str, other: str) -> bool:
    """Whether two different paths of parameters name a number in common."""
    a, b = one.split("."), other.split(".")
    # arm, numbers and component of each path; what a path leaves out stands for every one
    marks: tuple[Callable[[list[str]], list[str]], ...] = (
        lambda parts: [part for part in parts if part in robot.arms],
        lambda parts: [part for part in parts if part.isdecimal()],
        lambda parts: [part for part in parts[-1:] if part in paths.components(robot.joints)],
    )
    return bounds.plain(robot, one) == bounds.plain(robot, other) and all(
        not mark(a) or not mark(b) or mark(a) == mark(b) for mark in marks
    )


def _observers(config: CampaignConfig) -> Iterator[Complaint]:
    cues = config.haptics.cues()
    if len(set(cues)) < len(cues):
        yield (
            ("haptics",),
            "two of the haptic sets are the same: write each threshold, gain and cap once",
        )
    names = [detector.name for detector in config.detector]
    for d, detector in enumerate(config.detector):
        if names.index(detector.name) != d:
            yield (
                ("detector", d, "name"),
                f"got {detector.name!r} twice, expected a name of its own for each detector",
            )
        for name in ("fusion", "consecutive", "threshold"):
            values: Iterable[Any] = getattr(detector, name)
            value, times = Counter(values).most_common(1)[0]
            if times > 1:
                yield (
                    ("detector", d, name),
                    f"got {shown(value)} {times} times, expected each value once",
                )
