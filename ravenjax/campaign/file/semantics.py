"""The words of a campaign: whether its sites, channels, effects, arms and times exist and fit
together.

What pydantic cannot say because it takes two sections, or the robot's declared sites, to see it. Of
values that are drawn the ends are looked at here, each one when the fault table is made.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence

from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.axis import Axis, Moment
from ravenjax.campaign.file.bounds import extent
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import Fault, Group
from ravenjax.campaign.file.location import Complaint, Key
from ravenjax.errors import shown, suggestion
from ravenjax.numbers import paths
from ravenjax.outcomes import events
from ravenjax.vocabulary.effects import EFFECTS, MAX_SLOTS, NETWORK_EFFECTS, TRIGGERS, WITHOUT_VALUE
from ravenjax.vocabulary.legal import complaint, legal, rounding
from ravenjax.vocabulary.sites import Channel, Site

ALL = "*"
"""`channel` that stands for every channel of the site."""

OWN = re.compile(r"(detectors\.own|checks\.own|checks\.threshold|control\.own|operator\.own)\.")
"""Beginning of the paths of parameters of parts of one's own."""

LARGEST = 3.4028234663852886e38
"""Values are held in single precision."""


def complaints(config: CampaignConfig) -> Iterator[Complaint]:
    """Every (key, message) that is wrong with a config of valid shape."""
    yield from _campaign(config)
    names = [group.name for group in config.group]
    for g, group in enumerate(config.group):
        if names.index(group.name) != g:
            yield (
                ("group", g, "name"),
                f"got {group.name!r} twice, expected a name of its own for each group",
            )
        yield from _group(config, group, ("group", g))
    for key, table in parameter_tables(config):
        for path, axis in table.items():
            more = config.own_ranges if OWN.match(path) else ()
            yield from (
                ((*key, path), message)
                for message in bounds.complaints(config.robot, path, axis, more)
            )


def unfit_parameters(config: CampaignConfig, names: Iterable[str]) -> Iterator[Complaint]:
    """(key, message) of each varied parameter that is not a path in `known`, or whose list reads
    like a vector.
    """
    names = list(names)
    for key, table in parameter_tables(config):
        for path, axis in table.items():
            if path not in names:
                yield (
                    (*key, path),
                    f"unknown parameter{_section_of(path, names) or suggestion(path, names)}",
                )
            elif axis.kind == "list" and not axis.explicit:
                parts = [
                    full.rpartition(".")[2] for full in names if full.rpartition(".")[0] == path
                ]
                parts = [part for part in parts if part in paths.components(config.robot.joints)]
                if len(axis.values) == len(parts):
                    yield (*key, path), _ambiguous(path, axis, parts)


def _section_of(path: str, names: Sequence[str]) -> str:
    """What to add for a parameter that is there with another section of the file only."""
    sections = {
        "reaction": "[reaction]",
        "hand": "[hand]",
        "detectors": "[[detector]]",
        "checks": "[[check]]",
    }
    first = path.partition(".")[0]
    if first == "contact" and not any(name.startswith("contact.") for name in names):
        return ": nothing is touched; write contact = true in [campaign]"
    section = None if any(name.startswith(f"{first}.") for name in names) else sections.get(first)
    return f": there is none without a section {section}; write one" if section else ""


def _ambiguous(path: str, axis: Axis, parts: Sequence[str]) -> str:
    each = ", ".join(
        f"{path}.{part} = {value:g}" for part, value in zip(parts, axis.values, strict=True)
    )
    levels = ", ".join(f"{value:g}" for value in axis.values)
    return (
        f"got a list of {len(parts)} for a vector of {len(parts)} numbers ({', '.join(parts)}),"
        f" which may be meant in two ways. One number each: write {each}. {len(parts)} levels, each"
        f" for all of them: write {{ list = [{levels}] }}"
    )


def parameter_tables(config: CampaignConfig) -> Iterator[tuple[Key, dict[str, Axis]]]:
    """(key, {path: axis}) of every table of parameters in the file."""
    yield ("parameters",), config.parameters
    yield ("cross",), config.cross
    for g, group in enumerate(config.group):
        yield ("group", g, "parameters"), group.parameters
        yield ("group", g, "cross"), group.cross
        yield from (
            (("group", g, "run", r, "parameters"), run.parameters)
            for r, run in enumerate(group.run)
        )


def _together(config: CampaignConfig) -> Iterator[Complaint]:
    """Lists that are drawn in one need one length; a fault has none, whose runs would then be
    those of few robots.
    """
    for g, group in enumerate(config.group):
        axes = {**config.parameters, **group.parameters}
        lengths = {path: len(axis.values) for path, axis in axes.items() if axis.kind == "together"}
        if len({*lengths.values()}) > 1:
            path, other = (
                min(lengths, key=lengths.__getitem__),
                max(lengths, key=lengths.__getitem__),
            )
            key = (
                ("group", g, "parameters", path)
                if path in group.parameters
                else ("parameters", path)
            )
            yield (
                key,
                (
                    f"has {lengths[path]} values, drawn together with {lengths[other]} of {other}:"
                    " write as many"
                ),
            )
        for f, fault in enumerate(group.fault):
            for name in type(fault).model_fields:
                if isinstance(axis := getattr(fault, name), Axis) and axis.kind == "together":
                    yield (
                        ("group", g, "fault", f, name),
                        "got together, which parameters alone can be; write choice",
                    )


def _campaign(config: CampaignConfig) -> Iterator[Complaint]:
    arms, names = config.campaign.arms, config.robot.arms
    if list(arms) != [arm for arm in names if arm in arms]:
        yield (
            ("campaign", "arms"),
            f"got {list(arms)}, expected each arm once, in the order {list(names)}",
        )
    yield from config.complaints()
    yield from _checks(config)
    yield from _together(config)
    if config.outcomes.cue >= len(config.haptics.cues()):
        count = len(config.haptics.cues())
        yield (
            ("outcomes", "cue"),
            f"got {config.outcomes.cue}, expected 0..{count - 1}: [haptics] makes {count} sets",
        )

    if (
        config.stop is not None
        and "cable_overload" in config.stop.rates
        and not config.watches_cables
    ):
        yield ("stop", "rates"), f"got 'cable_overload', {events.UNWATCHED}"


def _checks(config: CampaignConfig) -> Iterator[Complaint]:
    """Of [[check]]."""
    seams, names = config.robot.check_seams, [check.name for check in config.check]
    for c, check in enumerate(config.check):
        if not seams:
            yield (
                ("check", c),
                (
                    f"robot {config.robot.name!r} has no seam where a check of one's own may stand:"
                    " remove it"
                ),
            )
        elif check.at not in seams:
            yield ("check", c, "at"), unknown("seam", check.at, seams)
        if names.index(check.name) != c:
            yield (
                ("check", c, "name"),
                f"got {check.name!r} twice, expected a name of its own for each check",
            )
        if check.name in config.robot.arms:
            yield (
                ("check", c, "name"),
                f"got {check.name!r}, which is an arm: paths of its parameters could be read twice",
            )


def _group(config: CampaignConfig, group: Group, key: Key) -> Iterator[Complaint]:
    if len(group.fault) > MAX_SLOTS:
        yield (
            (*key, "fault"),
            f"got {len(group.fault)} faults, expected at most {MAX_SLOTS} in one run",
        )
    slots = [
        ((*key, "fault", f), fault) for f, fault in enumerate(group.fault if not group.run else ())
    ]
    for r, run in enumerate(group.run):
        slots += [
            ((*key, "run", r, "fault", f), fault) for f, fault in enumerate(group.faults_of(run))
        ]
    for slot, fault in slots:
        errors = list(_fault(config, fault, slot))
        yield from errors or _value(config, fault, slot, paired=group.design == "zip")
    for r, run in enumerate(group.run):
        if len(run.fault) > len(group.fault):
            yield (
                (*key, "run", r, "fault"),
                f"got {len(run.fault)} faults, the group has {len(group.fault)}",
            )
        for path, axis in run.parameters.items():
            if axis.kind != "fixed":
                yield (
                    (*key, "run", r, "parameters", path),
                    "a run of design 'list' takes single values",
                )
    if group.design == "zip":
        lengths = {
            name: len(axis.values) for name, axis in _axes(config, group) if axis.kind == "list"
        }
        if len({length for length in lengths.values() if length > 1}) > 1:
            yield (*key, "design"), f"'zip' needs lists of one length, got lengths {lengths}"
    is_random = any(axis.drawn for _, axis in _axes(config, group))
    if group.repeats > 1 and not (is_random or random_in_itself(config, group)):
        yield (
            (*key, "repeats"),
            (
                f"the {group.repeats} repeats would be identical: nothing in them is random. "
                "Set campaign.noise = true, vary start_ms instead, or remove repeats"
            ),
        )


def random_in_itself(config: CampaignConfig, group: Group) -> bool:
    """Whether two runs of a group with the same row but another seed may differ: by noise,
    packets, or an effect.
    """
    varied = {**config.parameters, **group.parameters}
    parameters = {bounds.plain(config.robot, path): axis for path, axis in varied.items()}
    silent = all(
        name in parameters and parameters[name].values == (0,) for name in config.robot.noise
    )
    draws = (config.campaign.noise and not silent) or config.random_packets
    return draws or any("random" in fault.effect.listed for fault in group.fault)


def _axes(config: CampaignConfig, group: Group) -> Iterator[tuple[str, Axis]]:
    for f, fault in enumerate(group.fault):
        for name in type(fault).model_fields:
            if isinstance(axis := getattr(fault, name), Axis):
                yield f"fault[{f}].{name}", axis
    yield from {**config.parameters, **group.parameters}.items()


def _fault(config: CampaignConfig, fault: Fault, key: Key) -> Iterator[Complaint]:
    site = config.robot.sites.get(fault.site)
    if site is None:
        yield (*key, "site"), unknown("fault site", fault.site, config.robot.sites)
        return
    for effect in fault.effect.listed:
        if effect not in EFFECTS:
            yield (*key, "effect"), unknown("effect", effect, EFFECTS)
    for trigger in fault.trigger.listed:
        if trigger not in TRIGGERS:
            yield (*key, "trigger"), unknown("trigger", trigger, TRIGGERS)
    yield from _arm(config, fault, site, key)
    yield from _channel(fault, site, key)
    yield from _effect(fault, site, key)
    yield from _times(config, fault, key)


def _arm(config: CampaignConfig, fault: Fault, site: Site, key: Key) -> Iterator[Complaint]:
    arms = config.campaign.arms
    if fault.arm is None:
        if site.per_arm and len(arms) > 1:
            yield (
                (*key, "arm"),
                (
                    f"missing: site {site.name} is on each arm; write one of {', '.join(arms)} or a"
                    " list"
                ),
            )
        return
    if not site.per_arm:
        yield (*key, "arm"), f"site {site.name} belongs to no arm: remove the key"
        return
    for arm in fault.arm.listed:
        if arm not in arms:
            absent = (
                f"arm {arm!r} is not in this campaign: expected one of campaign.arms = {list(arms)}"
            )
            yield (*key, "arm"), absent if arm in config.robot.arms else unknown("arm", arm, arms)


def _channel(fault: Fault, site: Site, key: Key) -> Iterator[Complaint]:
    names = [channel.name for channel in site.channels]
    if fault.channel is None:
        needed = [effect for effect in fault.effect.listed if effect not in NETWORK_EFFECTS]
        if len(names) > 1 and needed:
            yield (
                (*key, "channel"),
                f"missing: site {site.name} has {', '.join(names)}; write one, a list, or {ALL!r}",
            )
        return
    for name in fault.channel.listed:
        if name not in names and not (name == ALL and fault.channel.kind == "fixed"):
            yield (*key, "channel"), unknown(f"channel of site {site.name}", name, names)


def _effect(fault: Fault, site: Site, key: Key) -> Iterator[Complaint]:
    effects = fault.effect.listed
    needs_value = [
        effect for effect in effects if effect in EFFECTS and effect not in WITHOUT_VALUE
    ]
    if fault.value is None and needs_value:
        yield (
            (*key, "value"),
            f"missing: effect {needs_value[0]!r} takes a value ({EFFECTS[needs_value[0]].meaning})",
        )
    for effect in effects:
        if effect in NETWORK_EFFECTS and site.name != "network":
            yield (*key, "effect"), f"{effect!r} belongs to site 'network', got site {site.name!r}"
    if "periodic" in effects and any(period <= 0 for period in fault.period_ms.values):
        yield (*key, "period_ms"), "effect 'periodic' needs a period of at least 1 ms"


def _value(config: CampaignConfig, fault: Fault, key: Key, paired: bool) -> Iterator[Complaint]:
    """The first value, or end of what is drawn, that one of the channels cannot take. Lists that
    are `paired` side by side meet only in the fault table, which looks at each of its values again.
    """
    if fault.value is None:
        return
    site, beyond = config.robot.sites[fault.site], config.says_beyond(fault)
    named = (
        fault.channel.listed if fault.channel is not None and fault.channel.listed != (ALL,) else ()
    )
    effects = [effect for effect in fault.effect.listed if effect not in WITHOUT_VALUE]
    channels = [channel for channel in site.channels if not named or channel.name in named]
    if paired and sum(len(items) > 1 for items in (effects, channels, fault.value.values)) > 1:
        return
    for effect in effects:
        aimed = (
            [site.channel(NETWORK_EFFECTS[effect][0])] if effect in NETWORK_EFFECTS else channels
        )
        for channel in aimed:
            for value in fault.value.listed or extent(fault.value):
                is_random = not fault.value.listed
                if message := _value_complaint(site, channel, effect, value, is_random, beyond):
                    yield (*key, "value"), message
                    return


def _value_complaint(
    site: Site, channel: Channel, effect: str, value: float, drawn: bool, beyond: bool
) -> str | None:
    if not abs(value) <= LARGEST:
        return f"got {shown(value)}, expected a number of single precision, at most {LARGEST:.4g}"
    rule = legal(channel, effect, beyond)
    value = math.floor(value) if drawn and rule.rounded else value
    if not rule.low <= value <= rule.high or (
        rule.whole and not drawn and value != math.floor(value)
    ):
        return complaint(site, channel, effect, value, beyond)
    field = channel.field
    if field and EFFECTS[effect].value == "number" and not field.low <= value <= field.high:
        return f"{channel.name} is {field.noun}: expected {field.low}..{field.high}, got {value:g}"
    return None if drawn else rounding(channel, effect, value)


def _times(config: CampaignConfig, fault: Fault, key: Key) -> Iterator[Complaint]:
    ticks = config.campaign.ticks
    yield from _phases(config, fault, key)
    times = (start for start in fault.start_ms.listed if not isinstance(start, Moment))
    start, last = max(times, default=0), last_start(config, fault, key)
    if start > last:
        of = "" if last == ticks - 1 else f"'s {last + 1} packets"
        expected = f"less than the run{of}" if of else f"less than the run's {ticks} ms"
        yield (
            (*key, "start_ms"),
            (
                f"got {start}, expected {expected}: it would never strike. Write an earlier"
                " start_ms, or a longer campaign.duration_s"
            ),
        )
    every, durations = fault.every_ms.listed or extent(fault.every_ms), fault.duration_ms.listed
    durations = durations or tuple(math.floor(end) for end in extent(fault.duration_ms))
    if any(e > 0 for e in every):
        longest = max(durations)
        if min(durations) < 0 or any(0 < e < longest for e in every):
            yield (
                (*key, "every_ms"),
                "a window that opens again needs a duration_ms that is not longer than every_ms",
            )


def _phases(config: CampaignConfig, fault: Fault, key: Key) -> Iterator[Complaint]:
    """Of an onset that is a place in a phase of the operation."""
    axis, names = fault.start_ms, config.robot.phases
    for phase in axis.phases:
        if not names:
            yield (
                (*key, "start_ms"),
                (
                    f"got phase {phase!r}, but robot {config.robot.name!r} has none: write a time"
                    " in ms"
                ),
            )
            return
        if phase not in names:
            yield (*key, "start_ms"), unknown("phase", phase, names)
            return
        if fault.trigger.listed != ("time",):
            others = [trigger for trigger in fault.trigger.listed if trigger != "time"]
            yield (
                (*key, "start_ms"),
                (
                    f"got phase {phase!r} with trigger {others[0]!r}, expected trigger = 'time':"
                    " the milliseconds of a phase count from the beginning of the run"
                ),
            )
            return


def last_start(config: CampaignConfig, fault: Fault, key: Key) -> int:
    """The last `start_ms` that a fault can have and yet strike; `key` says of which group it is."""
    ticks = config.campaign.ticks
    if fault.trigger.listed != ("packet",):
        return ticks - 1
    group = config.group[key[1]] if key[:1] == ("group",) and isinstance(key[1], int) else None
    tables = [config.parameters, config.cross, *([group.parameters, group.cross] if group else [])]
    cycles = [
        axis
        for table in tables
        for path, axis in table.items()
        if path == config.robot.packet_cycles
    ]
    least = min((value for axis in cycles[-1:] for value in axis.listed or axis.values), default=1)
    return math.ceil(ticks / max(config.cycles_a_packet, least)) - 1


def unknown(what: str, got: str, names: Iterable[str]) -> str:
    names = list(names)
    return f"unknown {what} {got!r}, expected one of {', '.join(names)}{suggestion(got, names)}"
