"""Checks rules of a campaign file that involve several sections, or the fault sites of the robot.

The module `bounds` checks ranges of parameters.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Any

from ravenjax.campaign.file.axis import END, Axis, Moment
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import Fault, Group
from ravenjax.campaign.file.location import Complaint
from ravenjax.errors import describe_unknown_name, format_value
from ravenjax.numbers import harm, paths
from ravenjax.outcomes import events
from ravenjax.vocabulary.effects import (
    EFFECTS,
    NETWORK_EFFECTS,
    RANDOM,
    TIMES,
    WITH_PERIOD,
    WITHOUT_VALUE,
)
from ravenjax.vocabulary.legal import find_illegal_value, find_rounding, legal_values
from ravenjax.vocabulary.sites import Channel, Site

LARGEST = 3.4028234663852886e38
"""Largest number of single precision, in which values are stored."""


def find_errors(config: CampaignConfig) -> Iterator[Complaint]:
    """Yield (key, message) of each mistake in a campaign whose keys have valid types."""
    arms, names = config.campaign.arms, config.robot.arms
    if list(arms) != [arm for arm in names if arm in arms]:
        message = f"got {list(arms)}, expected each arm once, in the order {list(names)}"
        yield ("campaign", "arms"), message
    yield from config.complaints()
    cue, sets = config.outcomes.cue, len(config.haptics.cues())
    if cue >= sets:
        yield ("outcomes", "cue"), f"got {cue}, expected 0..{sets - 1}: [haptics] has {sets} sets"
    if config.stop is not None:
        if "cable_overload" in config.stop.rates and not config.watches_cables:
            yield ("stop", "rates"), f"got 'cable_overload', {events.UNWATCHED}"
        if not any(group.fault for group in config.group):
            yield ("stop",), "has no effect, because no group has a fault; remove [stop]"
        if (limit := config.campaign.limit) is not None:
            yield (
                ("stop",),
                f"campaign.limit = {limit} would shorten the groups, but looks are shares of whole"
                " groups. To compute less, write a smaller last look, such as looks = [0.01, 0.05]",
            )
    for c, check in enumerate(config.check):
        if check.at not in config.robot.check_seams:
            message = describe_unknown_name("seam", check.at, config.robot.check_seams)
            yield ("check", c, "at"), message
        if check.name in names:
            yield ("check", c, "name"), f"{check.name!r} is the name of an arm; write another"
    windows = ((h, harm.WINDOW_END.findall(one.when)) for h, one in enumerate(config.harm))
    for key, times in (
        (("campaign", "duration_s"), [config.campaign.duration_ms]),
        (("campaign", "observe_ms"), [config.campaign.observe_ms]),
        *((("harm", h, "when"), map(int, ends)) for h, ends in windows),
    ):
        yield from ((key, message) for message in _uneven(times, config.robot.period_ms))
    for g, group in enumerate(config.group):
        yield from ((("group", g, *key), message) for key, message in _group(config, group))


def _uneven(times: Iterable[Any], tick_ms: int) -> Iterator[str]:
    """Yield a message for each time that is not a whole number of ticks."""
    for ms in times:
        if tick_ms > 1 and isinstance(ms, int | float) and (left := -ms % tick_ms):
            yield f"got {ms} ms, expected whole ticks of {tick_ms} ms, such as {ms + left} ms"


def _group(config: CampaignConfig, group: Group) -> Iterator[Complaint]:
    # Yields mistakes of a group: sites and channels that the robot lacks, and lengths of lists.
    runs = [(("run", r), group.faults_of(run)) for r, run in enumerate(group.run)]
    for key, faults in runs or [((), group.fault)]:
        for f, fault in enumerate(faults):
            if not (wrong := [*_fault(config, group, fault)]):
                unfit = find_unfit_values(config, group, fault, config.says_beyond(fault))
                wrong = [("value", message) for message in itertools.islice(unfit, 1)]
            for name, message in wrong:
                yield (*key, "fault", f, name), message
    axes = {**config.parameters, **group.parameters}
    drawn = {len(axis.values) for axis in axes.values() if axis.kind == "together"}
    if len(drawn) > 1:
        yield ("parameters",), f"together needs lists of one length, got lengths {sorted(drawn)}"
    for f, fault in enumerate(group.fault):
        axes |= {f"fault[{f}].{name}": axis for name, axis in fault.axes()}
        if fault.site in config.robot.sites:
            axes[f"fault[{f}].channel"] = fault.channels(config.robot.sites[fault.site])
    lists = {name: len(axis.values) for name, axis in axes.items() if axis.kind == "list"}
    if group.design == "zip" and len({*lists.values()} - {1}) > 1:
        yield ("design",), f"'zip' needs lists of one length, got lengths {lists}"


def _fault(config: CampaignConfig, group: Group, fault: Fault) -> Iterator[tuple[str, str]]:
    # Yields mistakes of one fault, as (key, message), except values that its channel cannot have.
    site = config.robot.sites.get(fault.site)
    if site is None:
        yield "site", describe_unknown_name("fault site", fault.site, config.robot.sites)
        return
    paired = group.design == "zip"
    yield from _place(config, fault, site, paired)
    yield from _onset(config, fault)
    effects = fault.effect.listed
    valued = [effect for effect in effects if effect not in WITHOUT_VALUE]
    if fault.value is None and valued:
        meaning = EFFECTS[valued[0]].meaning
        yield "value", f"missing: effect {valued[0]!r} needs a value ({meaning})"
    if fault.value is not None and not valued:
        yield "value", f"effect {effects[0]!r} has no value: remove the key"
    for name in TIMES:
        axis, unit = getattr(fault, name), fault.unit(name, config.robot.period_ms)
        # Draws of a normal distribution are rounded to ticks.
        for message in _uneven(axis.values, unit) if axis.kind != "normal" else ():
            yield name, message
    if "periodic" in effects and 0 in fault.period_ms.values:
        yield "period_ms", "effect 'periodic' needs a period of at least 1 ms"
    if not set(WITH_PERIOD).intersection(effects) and 0 not in fault.period_ms.values:
        yield "period_ms", f"effect {effects[0]!r} has no period: remove the key"
    for length, every in _combinations((fault.duration_ms, fault.every_ms), paired):
        if every and (length == END or every < length):
            needed = "a window that opens again needs a duration_ms of at most every_ms"
            yield "every_ms", f"got {every} with duration_ms {length}: {needed}"
            break


def _place(
    config: CampaignConfig, fault: Fault, site: Site, paired: bool
) -> Iterator[tuple[str, str]]:
    """Yield (key, message) for each wrong arm or channel, and each effect that the site lacks."""
    arms = config.campaign.arms
    if fault.arm is not None and not site.per_arm:
        yield "arm", f"site {site.name} is not part of an arm: remove the key"
    elif fault.arm is None and site.per_arm and len(arms) > 1:
        yield "arm", f"missing: each arm has site {site.name}; write {', '.join(arms)} or a list"
    elif strays := [arm for arm in (fault.arm.listed if fault.arm else ()) if arm not in arms]:
        yield "arm", f"arm {strays[0]!r} is not in this campaign, expected one of {list(arms)}"
    network = [effect for effect in fault.effect.listed if effect in NETWORK_EFFECTS]
    if network and site.name != "network":
        yield "effect", f"{network[0]!r} needs site 'network', got site {site.name!r}"
    names = [channel.name for channel in site.channels]
    channels = fault.channels(site).listed
    if channels == ("",):
        if len(network) < len(fault.effect.listed):
            listing = ", ".join(names) or site.where
            yield "channel", f"missing: site {site.name} has {listing}; write one, a list, or '*'"
    elif strays := [name for name in channels if name not in names]:
        yield "channel", describe_unknown_name(f"channel of site {site.name}", strays[0], names)
    elif site.name == "network":
        for effect, name in _combinations((fault.effect, fault.channels(site)), paired):
            if effect in network and name != (acts_on := NETWORK_EFFECTS[effect].channel):
                why = f"got {name!r}, but effect {effect!r} acts on {acts_on!r}: remove the key, or"
                yield "channel", f"{why} write another effect for {name!r}, such as 'overwrite'"
                return


def _onset(config: CampaignConfig, fault: Fault) -> Iterator[tuple[str, str]]:
    # A fault that starts after the run's end would never act.
    start, last, phases = fault.start_ms, last_start(config, fault), config.robot.phases
    for phase in start.phases:
        if phase not in phases:
            yield "start_ms", describe_unknown_name("phase", phase, phases)
    listed = [ms for ms in start.listed if not isinstance(ms, Moment)]
    if max(listed, default=0) > last:
        length = config.campaign.duration_ms
        end = f"{length} ms" if last == length - 1 else f"{last + 1} packets"
        yield (
            "start_ms",
            f"got {max(listed)}, expected less than {end}, the length of the run; the fault would"
            " never act. Write an earlier start_ms, or a longer campaign.duration_s",
        )


def find_unfit_values(
    config: CampaignConfig, group: Group, fault: Fault, beyond: bool
) -> Iterator[str]:
    """Yield a message for each value of a fault, or end of its distribution, that the channel
    cannot have.

    beyond: permit values beyond 16 bits.
    """
    if fault.value is None:
        return
    site = config.robot.sites[fault.site]
    axes = (fault.effect, fault.channels(site), fault.value)
    for effect, name, value in _combinations(axes, paired=group.design == "zip"):
        if effect not in WITHOUT_VALUE:
            aimed = NETWORK_EFFECTS[effect].channel if effect in NETWORK_EFFECTS else name
            if message := _misfit(site, site.channel(aimed), effect, value, fault.value, beyond):
                yield message


def _combinations(axes: tuple[Axis, ...], paired: bool) -> Iterator[tuple[Any, ...]]:
    """Yield the combinations of values of several keys. A distribution is replaced by its ends.

    paired: combine lists element by element.
    """
    lists = [axis for axis in axes if paired and axis.kind == "list"]
    for row in range(max((len(axis.values) for axis in lists), default=1)):
        yield from itertools.product(
            *(
                (axis.values[row % len(axis.values)],)
                if axis in lists
                else axis.listed or axis.extent
                for axis in axes
            )
        )


def _misfit(
    site: Site, channel: Channel, effect: str, value: float, axis: Axis, beyond: bool
) -> str | None:
    """Return a message if a channel cannot have `value`, else None.

    value: a value of `axis`, or an end of its distribution.
    """
    if not abs(value) <= LARGEST:
        return f"got {format_value(value)}, expected at most {LARGEST:.4g} (single precision)"
    rule, drawn = legal_values(channel, effect, beyond), not axis.listed
    if drawn and rule.rounded:
        low, high = axis.extent
        if math.ceil(low) > math.floor(high) or (axis.kind == "uniform" and value % 1):
            return (
                f"got {axis.kind} = {list(axis.values)}, but {channel.name} is a whole number"
                f" ({channel.unit}): write whole ends, such as {math.floor(low)} and"
                f" {math.ceil(high)}"
            )
        value = math.trunc(value)
    if not rule.low <= value <= rule.high or (rule.whole and not drawn and value % 1):
        return find_illegal_value(site, channel, effect, value, beyond)
    field = channel.field
    if field and EFFECTS[effect].value == "number" and not field.low <= value <= field.high:
        return f"{channel.name} is {field.noun}: expected {field.low}..{field.high}, got {value:g}"
    return None if drawn else find_rounding(channel, effect, value)


def last_start(config: CampaignConfig, fault: Fault) -> int:
    """Return the largest `start_ms` at which a fault still acts in the run."""
    if fault.trigger.listed != ("packet",):
        return config.campaign.duration_ms - 1
    axis = config.parameters.get(config.robot.packet_cycles)
    least = 1 if axis is None else min(axis.listed or axis.values)
    return math.ceil(config.campaign.ticks / max(config.cycles_a_packet, least)) - 1


def random_in_itself(config: CampaignConfig, group: Group) -> bool:
    """Return whether equal runs of a group with different seeds may have different outcomes.

    Noise, durations of packets or an effect may be random.
    """
    draws = (config.campaign.noise and not is_silent(config, group)) or config.random_packets
    return draws or any(set(RANDOM).intersection(fault.effect.listed) for fault in group.fault)


def is_silent(config: CampaignConfig, group: Group) -> bool:
    """Return whether every size of the robot's noise is 0 in a group."""
    robot, axes = config.robot, {**config.parameters, **group.parameters}
    plain = {paths.plain_path(path, robot.arms, robot.joints): axis for path, axis in axes.items()}
    return all(path in plain and plain[path].values == (0,) for path in robot.noise)
