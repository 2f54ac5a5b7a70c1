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
from ravenjax.campaign.file.location import Complaint, Key
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
from ravenjax.vocabulary.sites import PARAMETER, Channel, Site

LARGEST_FLOAT32 = 3.4028234663852886e38
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
        if "cable_overload" in config.stop.rates and "overload" not in config.stages:
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
    times_by_key: dict[Key, Iterable[Any]] = {
        ("campaign", "duration_s"): [config.campaign.duration_ms],
        ("campaign", "observe_ms"): [config.campaign.observe_ms],
    }
    # Times in the expression of a harm, such as 100 in `once[0:100](speed > 50)`.
    for h, own_harm in enumerate(config.harm):
        times_by_key["harm", h, "when"] = map(int, harm.WINDOW_END.findall(own_harm.when))
    for key, times in times_by_key.items():
        yield from ((key, message) for message in _find_broken_ticks(times, config.robot.period_ms))
    for g, group in enumerate(config.group):
        for key, message in _find_group_errors(config, group):
            yield ("group", g, *key), message


def _find_broken_ticks(times: Iterable[Any], tick_ms: int) -> Iterator[str]:
    """Yield a message for each time, ms, that is no multiple of a tick. Texts are skipped."""
    for ms in times:
        if tick_ms > 1 and isinstance(ms, int | float) and (missing := -ms % tick_ms):
            yield f"got {ms} ms, expected whole ticks of {tick_ms} ms, such as {ms + missing} ms"


def _find_group_errors(config: CampaignConfig, group: Group) -> Iterator[Complaint]:
    # Yields mistakes of a group: sites and channels that the robot lacks, and lengths of lists. The
    # keys are relative to the group.
    runs = [(("run", r), group.faults_of(run)) for r, run in enumerate(group.run)]
    # A group without tables [[group.run]] has its own faults.
    for key, faults in runs or [((), group.fault)]:
        for f, fault in enumerate(faults):
            errors = list(_find_fault_errors(config, group, fault))
            # Values can be checked only if site, channel and effect are correct, and the ranges of
            # parameters are known (see `CampaignConfig.robot`).
            if not errors and not (fault.site == PARAMETER and config._is_being_read):
                unfit = find_unfit_values(config, group, fault, config.allows_beyond_16_bits(fault))
                errors = [("value", message) for message in itertools.islice(unfit, 1)]
            for name, message in errors:
                yield (*key, "fault", f, name), message
    axes = {**config.parameters, **group.parameters}
    # A run uses the same position in all lists of kind `together`.
    lengths = {len(axis.values) for axis in axes.values() if axis.kind == "together"}
    if len(lengths) > 1:
        yield ("parameters",), f"together needs lists of one length, got lengths {sorted(lengths)}"
    for f, fault in enumerate(group.fault):
        axes |= {f"fault[{f}].{name}": axis for name, axis in fault.axes()}
        if fault.site in config.robot.sites:
            axes[f"fault[{f}].channel"] = fault.channels(config.robot.sites[fault.site])
    list_lengths = {name: len(axis.values) for name, axis in axes.items() if axis.kind == "list"}
    # A list of one value is a value for all runs.
    if group.design == "zip" and len({*list_lengths.values()} - {1}) > 1:
        yield ("design",), f"'zip' needs lists of one length, got lengths {list_lengths}"


def _find_fault_errors(
    config: CampaignConfig, group: Group, fault: Fault
) -> Iterator[tuple[str, str]]:
    # Yields mistakes of one fault, as (key, message), except values that its channel cannot have.
    site = config.robot.sites.get(fault.site)
    if site is None:
        yield "site", describe_unknown_name("fault site", fault.site, config.robot.sites)
        return
    paired = group.design == "zip"
    yield from _find_site_errors(config, fault, site, paired)
    yield from _find_start_errors(config, fault)
    effects = fault.effect.listed
    effects_with_value = [effect for effect in effects if effect not in WITHOUT_VALUE]
    if fault.value is None and effects_with_value:
        effect = effects_with_value[0]
        yield "value", f"missing: effect {effect!r} needs a value ({EFFECTS[effect].meaning})"
    if fault.value is not None and not effects_with_value:
        yield "value", f"effect {effects[0]!r} has no value: remove the key"
    for name in TIMES:
        axis = getattr(fault, name)
        # Draws of a normal distribution are rounded to ticks, so its mean may be any time.
        if axis.kind != "normal":
            unit = fault.unit(name, config.robot.period_ms)
            yield from ((name, message) for message in _find_broken_ticks(axis.values, unit))
    # 0 is the default, if the key is missing. Effect `lose` also has a period, and accepts 0.
    if "periodic" in effects and 0 in fault.period_ms.values:
        yield "period_ms", "effect 'periodic' needs a period of at least 1 ms"
    if not set(WITH_PERIOD).intersection(effects) and 0 not in fault.period_ms.values:
        yield "period_ms", f"effect {effects[0]!r} has no period: remove the key"
    for duration, every in _combinations((fault.duration_ms, fault.every_ms), paired):
        if every and (duration == END or every < duration):
            rule = "a window that opens again needs a duration_ms of at most every_ms"
            yield "every_ms", f"got {every} with duration_ms {duration}: {rule}"
            break


def _find_site_errors(
    config: CampaignConfig, fault: Fault, site: Site, paired: bool
) -> Iterator[tuple[str, str]]:
    """Yield (key, message) of each wrong arm, channel or effect. paired: the design is "zip"."""
    arms = config.campaign.arms
    fault_arms = fault.arm.listed if fault.arm else ()
    if fault.arm is not None and not site.per_arm:
        yield "arm", f"site {site.name} is not part of an arm: remove the key"
    elif fault.arm is None and site.per_arm and len(arms) > 1:
        yield "arm", f"missing: each arm has site {site.name}; write {', '.join(arms)} or a list"
    elif unknown := [arm for arm in fault_arms if arm not in arms]:
        yield "arm", f"arm {unknown[0]!r} is not in this campaign, expected one of {list(arms)}"
    network = [effect for effect in fault.effect.listed if effect in NETWORK_EFFECTS]
    if network and site.name != "network":
        yield "effect", f"{network[0]!r} needs site 'network', got site {site.name!r}"
    names = [channel.name for channel in site.channels]
    channels = fault.channels(site).listed
    if channels == ("",):
        # Only a network effect needs no channel, because it determines the channel.
        if len(network) < len(fault.effect.listed):
            listing = ", ".join(names) or site.where
            yield "channel", f"missing: site {site.name} has {listing}; write one, a list, or '*'"
    elif unknown := [name for name in channels if name not in names]:
        yield "channel", describe_unknown_name(f"channel of site {site.name}", unknown[0], names)
    elif site.name == "network":
        for effect, name in _combinations((fault.effect, fault.channels(site)), paired):
            # The channel that a network effect determines.
            acts_on = NETWORK_EFFECTS[effect].channel if effect in network else name
            if name != acts_on:
                yield (
                    "channel",
                    f"got {name!r}, but effect {effect!r} acts on {acts_on!r}: remove the key, or"
                    f" write another effect for {name!r}, such as 'overwrite'",
                )
                return


def _find_start_errors(config: CampaignConfig, fault: Fault) -> Iterator[tuple[str, str]]:
    # Yields (key, message) for an unknown phase, and for a start after the end of the run.
    limit, phases = 1 + last_start(config, fault), config.robot.phases
    for phase in fault.start_ms.phases:
        if phase not in phases:
            yield "start_ms", describe_unknown_name("phase", phase, phases)
    times = [start for start in fault.start_ms.listed if not isinstance(start, Moment)]
    if max(times, default=0) >= limit:
        unit = "packets" if fault.trigger.listed == ("packet",) else "ms"
        yield (
            "start_ms",
            f"got {max(times)}, expected less than {limit} {unit}, the length of the run; the fault"
            " would never act. Write an earlier start_ms, or a longer campaign.duration_s",
        )


def find_unfit_values(
    config: CampaignConfig, group: Group, fault: Fault, beyond: bool
) -> Iterator[str]:
    """Yield a message for each value of a fault, or end of its distribution, that the channel
    cannot have. beyond: permit values beyond 16 bits.
    """
    if fault.value is None:
        return
    site = config.robot.sites[fault.site]
    axes = (fault.effect, fault.channels(site), fault.value)
    for effect, name, value in _combinations(axes, paired=group.design == "zip"):
        if effect not in WITHOUT_VALUE:
            network = NETWORK_EFFECTS.get(effect)
            channel = site.channel(network.channel if network else name)
            if message := _find_value_error(site, channel, effect, value, fault.value, beyond):
                yield message


def _combinations(axes: tuple[Axis, ...], paired: bool) -> Iterator[tuple[Any, ...]]:
    # Yields the combinations of values of several keys. A distribution is replaced by its ends.
    # paired: combine lists element by element, as in design "zip".
    paired_axes = [axis for axis in axes if paired and axis.kind == "list"]
    for row in range(max((len(axis.values) for axis in paired_axes), default=1)):
        # A list of one value has this value in every row.
        choices = [
            (axis.values[row % len(axis.values)],)
            if axis in paired_axes
            else axis.listed or axis.extent
            for axis in axes
        ]
        yield from itertools.product(*choices)


def _find_value_error(
    site: Site, channel: Channel, effect: str, value: float, axis: Axis, beyond: bool
) -> str | None:
    # Returns a message if a channel cannot have `value`, else None. value: a value of `axis`, or an
    # end of its distribution. beyond: permit values beyond 16 bits.
    # This also refuses NaN.
    if not abs(value) <= LARGEST_FLOAT32:
        limit = f"{LARGEST_FLOAT32:.4g} (single precision)"
        return f"got {format_value(value)}, expected at most {limit}"
    rule = legal_values(channel, effect, beyond)
    drawn = not axis.listed
    if drawn and rule.rounded:
        low, high = axis.extent
        if not axis.fits_whole_numbers:
            return (
                f"got {axis.kind} = {list(axis.values)}, but {channel.name} is a whole number"
                f" ({channel.unit}): write whole numbers as limits, such as {math.floor(low)} and"
                f" {math.ceil(high)}"
            )
        # Draws are rounded to whole numbers inside the distribution.
        value = math.trunc(value)
    if not rule.low <= value <= rule.high or (rule.whole and not drawn and value % 1):
        return find_illegal_value(site, channel, effect, value, beyond)
    field = channel.field
    if field and EFFECTS[effect].value == "number" and not field.low <= value <= field.high:
        return f"{channel.name} is {field.noun}: expected {field.low}..{field.high}, got {value:g}"
    return None if drawn else find_rounding(channel, effect, value)


def last_start(config: CampaignConfig, fault: Fault) -> int:
    """Return the largest `start_ms`, in ms or packets, at which a fault still acts in the run."""
    if fault.trigger.listed != ("packet",):
        return config.campaign.duration_ms - 1
    # The campaign gives a mean number of cycles per packet, or a parameter gives the number. The
    # unused one of both numbers is 1.
    axis = config.parameters.get(config.robot.packet_cycles)
    least_cycles = 1 if axis is None else min(axis.listed or axis.values)
    return math.ceil(config.campaign.ticks / max(config.cycles_a_packet, least_cycles)) - 1


def random_in_itself(config: CampaignConfig, group: Group) -> bool:
    """Return whether equal runs of a group with different seeds may have different outcomes. Noise,
    durations of packets or an effect may be random.
    """
    has_noise = config.campaign.noise and not is_silent(config, group)
    has_random_effect = any(set(RANDOM).intersection(fault.effect.listed) for fault in group.fault)
    return has_noise or config.random_packets or has_random_effect


def is_silent(config: CampaignConfig, group: Group) -> bool:
    """Return whether every size of the robot's noise is 0 in a group."""
    robot = config.robot
    axes = {
        paths.plain_path(path, robot.arms, robot.joints): axis
        for path, axis in {**config.parameters, **group.parameters}.items()
    }
    return all(path in axes and axes[path].values == (0,) for path in robot.noise)
