"""What may be written of one fault site: its channels, and the values that each effect takes
there.
"""

from __future__ import annotations

import math

from ravenjax.errors import UserError
from ravenjax.hazards import ranges
from ravenjax.vocabulary.effects import EFFECTS, NETWORK_EFFECTS, WITHOUT_VALUE
from ravenjax.vocabulary.legal import legal
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import Channel, Site

CHANNEL_COLUMNS = ("channel", "number", "unit", "without a fault")
EFFECT_COLUMNS = ("effect", "meaning", "value")


def channels(robot: Robot, site: Site) -> list[tuple[str, ...]]:
    """One row a channel: name, type of its number, unit, and where it is when nothing is wrong."""
    return [(one.name, one.kind, one.unit, _normal(robot, site, one)) for one in site.channels]


def effects(site: Site) -> list[tuple[str, ...]]:
    """One row an effect that the site takes: name, meaning, and what its value may be, channel
    by channel.
    """
    return [
        (effect.name, effect.meaning, values(site, effect.name))
        for effect in EFFECTS.values()
        if effect.network is None or site.name == "network"
    ]


def values(site: Site, effect: str) -> str:
    """What the value of an effect may be at the channels of a site, in words."""
    if effect in WITHOUT_VALUE:
        return "takes none"
    aimed = (
        [site.channel(NETWORK_EFFECTS[effect][0])] if effect in NETWORK_EFFECTS else site.channels
    )
    spans: dict[str, list[str]] = {}
    for channel in aimed:
        spans.setdefault(_span(site, channel, effect), []).append(channel.name)
    if len(spans) == 1:
        return next(iter(spans))
    return "; ".join(f"{', '.join(names)}: {span}" for span, names in spans.items())


def _span(site: Site, channel: Channel, effect: str) -> str:
    rule = legal(channel, effect)
    low, high = rule.low, rule.high
    if effect == "bit_flip":
        return f"bit {low:.0f}..{high:.0f}"
    if effect == "delay":
        return f"{low:.0f}..{high:.0f} packets, whole"
    if effect == "scale":
        return "any factor"
    if channel.field and EFFECTS[effect].value == "number":
        low, high = channel.field.low, channel.field.high
    unit = "" if channel.unit == "1" else f" {channel.unit}"
    if math.isinf(low):
        return f"any number{unit and f', in{unit}'}"
    beyond = ""
    if channel.kind == "int16":
        beyond = ", beyond with wraps = true" + (" or campaign.dac_words" if site.beyond else "")
    return f"{low:.10g}..{high:.10g}{unit}{', whole' if rule.whole else ''}{beyond}"


def _normal(robot: Robot, site: Site, channel: Channel) -> str:
    """The range of a channel in fault-free runs, of each arm where they differ."""
    spans = {}
    for arm in robot.arms if site.per_arm else robot.arms[:1]:
        try:
            normal = ranges.normal(site.name, channel.name, arm)
        except UserError:
            continue
        spans[arm] = f"{normal.low:.4g}..{normal.high:.4g}"
    if len(set(spans.values())) == 1:
        return next(iter(spans.values()))
    return ", ".join(f"{arm} {span}" for arm, span in spans.items())
