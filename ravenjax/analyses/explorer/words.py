"""What a page says of a campaign: sites in plain words, ranges of values, checks, and the file
that a command needs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import tomlkit

from ravenjax.analyses.explorer import program
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.hazards import ranges
from ravenjax.outcomes import verdict
from ravenjax.report.data.facts import OUTCOMES
from ravenjax.vocabulary.effects import EFFECTS
from ravenjax.vocabulary.sites import Channel, Site

SITES: dict[str, str] = {
    "hand": "the surgeon's hand",
    "console": "the console's motion scaling",
    "network": "the network between console and robot",
    "packet": "a motion packet from the console",
    "packet_header": "the header of a motion packet",
    "encoder": "an encoder",
    "usb_in": "what the computer reads over USB",
    "usb_status": "a USB transfer",
    "runlevel": "the run level that is asked for",
    "mpos": "the motor position that the software estimates",
    "mvel": "the motor velocity that the software estimates",
    "jpos": "the joint position that the software estimates",
    "jvel": "the joint velocity that the software estimates",
    "pos": "the tip position that the software estimates",
    "ori": "the tip rotation that the software estimates",
    "pos_d": "the tip position that is asked for",
    "ori_d": "the tip rotation that is asked for",
    "jpos_d": "the joint position that is asked for",
    "mpos_d": "the motor position that is asked for",
    "tau_d": "the torque that is asked for",
    "current_cmd": "the motor command, before the checks",
    "usb_out": "the motor command, after the last check",
    "pins_out": "the output pins to the safety controller",
    "plc": "the run level of the safety controller",
    "buttons": "the buttons of the safety controller",
    "torque_scale": "the strength of a motor",
    "cable_scale": "the stiffness of a cable",
    "friction_scale": "the friction of a joint",
    "external_torque": "a load on a joint from outside",
    "brake": "the brakes",
}
"""Each site of the Raven-II in words that need no manual; of another robot's site its own words
stand.
"""

EFFECT_WORDS = {
    "overwrite": "replaced by",
    "offset": "shifted by",
    "latch_offset": "held, shifted by",
    "scale": "multiplied by",
    "drift": "drifts each millisecond by",
    "stuck": "stuck",
    "bit_flip": "one bit flipped:",
    "periodic": "shaken by",
    "random": "noisy, up to",
    "toggle": "switched on and off:",
    "drop": "lost",
    "duplicate": "repeated",
    "delay": "late by",
}
"""What an effect does to the number, before its value."""

UNITS = {"cnt": "counts", "um": "µm", "mrad": "mrad", "1": "", "N m": "N m", "rad/s": "rad/s"}
UNASKED = ("periodic", "random")
"""Effects that a page does not offer: a period is not among its controls, and random numbers are
those of a row.
"""
WIDER = 5.0
"""A value's range on the page goes so many times beyond what the channel does without a fault."""


def campaign(config: CampaignConfig) -> dict[str, Any]:
    """JSON of all that the page's words, controls and commands need."""
    robot, arms, cues = config.robot, config.campaign.arms, config.haptics.cues()
    return {
        "name": config.campaign.name,
        "description": config.campaign.description,
        "robot": robot.title,
        "arms": list(arms),
        "joints": list(robot.joints),
        "duration_ms": round(1000 * config.campaign.duration_s),
        "limit_mm": config.outcomes.limit_mm,
        "halt_ms": verdict.HALT_MS,
        "cue": config.outcomes.cue,
        "cues": {
            "threshold_mm": [round(cue.threshold_m * 1e3, 9) for cue in cues],
            "kp_per_mm": [round(cue.kp / 1e3, 9) for cue in cues],
            "kd_per_mm_s": [round(cue.kd / 1e3, 9) for cue in cues],
            "cap": [cue.cap for cue in cues],
        },
        "sites": [_site(site, robot.layers, arms) for site in robot.sites.values()],
        "effects": {
            name: {"words": EFFECT_WORDS[name], "meaning": effect.meaning, "value": effect.value}
            for name, effect in EFFECTS.items()
        },
        "checks": {
            name: {"meaning": check.meaning, "does": check.does, "unit": check.unit}
            for name, check in robot.checks.items()
        },
        "unasked": list(UNASKED),
        "outcomes": OUTCOMES,
        "values": _values(config),
        "toml": _toml(config),
        "varied": _varied(config),
    }


def _site(site: Site, layers: Any, arms: Iterable[str]) -> dict[str, Any]:
    return {
        "site": site.name,
        "layer": layers[site.layer],
        "words": SITES.get(site.name, site.where),
        "where": site.where,
        "per_arm": site.per_arm,
        "channels": [_channel(site, channel, next(iter(arms))) for channel in site.channels],
    }


def _channel(site: Site, channel: Channel, arm: str) -> dict[str, Any]:
    usual = ranges.measured().get((site.name, arm if site.per_arm else "", channel.name))
    low, high = channel.extent
    return {
        "name": channel.name,
        "unit": UNITS.get(channel.unit, channel.unit),
        "whole": channel.kind != "float",
        "bits": channel.bits,
        "low": low,
        "high": high,
        "usual": [usual.low_permille, usual.high_permille] if usual else None,
    }


def _values(config: CampaignConfig) -> dict[str, list[float]]:
    """site/effect -> least and greatest value that the campaign's own faults have."""
    spans: dict[str, list[float]] = {}
    for group in config.model_dump(mode="json")["group"]:
        for fault in group.get("fault") or ():
            numbers = [float(number) for number in _numbers(fault.get("value"))]
            effects = fault["effect"] if isinstance(fault["effect"], list) else [fault["effect"]]
            for effect in effects if numbers else ():
                span = spans.setdefault(f"{fault['site']}/{effect}", [min(numbers), max(numbers)])
                span[:] = [min(span[0], *numbers), max(span[1], *numbers)]
    return spans


def _numbers(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [number for inner in value.values() for number in _numbers(inner)]
    if isinstance(value, list):
        return [number for inner in value for number in _numbers(inner)]
    return [value] if isinstance(value, int | float) and not isinstance(value, bool) else []


def _varied(config: CampaignConfig) -> list[str]:
    """Parameters that have several values in the whole campaign."""
    return [path for path, axis in config.parameters.items() if axis.kind != "fixed"] + [
        *config.cross
    ]


def _file(value: Any) -> str:
    """What a file is called where it lies beside another one."""
    assert isinstance(value, Path), value
    return value.name


def _toml(config: CampaignConfig) -> str:
    """The campaign's file without cues, groups and what varies, which a page adds; what it reads
    lies beside it.

    The name of a motion that a page may exchange is the first line of [operator]."""
    apart = {"group", "stop", "haptics", "cross"}
    content = config.model_dump(exclude_defaults=True, exclude=apart)
    tables = json.loads(json.dumps(content, default=_file))
    varied = _varied(config)
    tables["parameters"] = {
        path: one for path, one in tables.get("parameters", {}).items() if path not in varied
    }
    if (motion := program.motion_name(config)) is not None:
        tables["operator"] = {"motion": motion} | tables.get("operator", {})
    return tomlkit.dumps({name: table for name, table in tables.items() if table})
