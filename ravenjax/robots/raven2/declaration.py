"""What the Raven-II declares of itself, without JAX: `declaration.toml` as records."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.seams import Seam, SeamChannel
from ravenjax.vocabulary.signals import Signal
from ravenjax.vocabulary.sites import ARM, Channel, Field, Site

FILE = "declaration.toml"
_TABLES = tomllib.loads((Path(__file__).parent / FILE).read_text(encoding="utf-8"))
_NAMES = {
    "joints": JOINTS,
    "positioning": JOINTS[:3],
    "axes": ("x", "y", "z"),
    "quaternion": ("qx", "qy", "qz", "qw"),
    "matrix": tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
}
_FIELDS = {name: Field(**field) for name, field in _TABLES["fields"].items()}


def _channel_units(table: dict[str, Any]) -> list[tuple[str, str]]:
    """(name, unit) of the channels that one table stands for."""
    names, unit = table["names"], table["unit"]
    linear = table.get("linear", unit)
    return [
        (name, linear if name == "insertion" else unit) for name in _NAMES.get(str(names), names)
    ]


def _site_channels(table: dict[str, Any]) -> list[Channel]:
    several = str(table["names"]) in _NAMES
    channels = []
    for place, (name, unit) in enumerate(_channel_units(table)):
        path = table.get("path", [ARM, "#"] if several else [name])
        indexed = tuple(place if step == "#" else step for step in path)
        field = _FIELDS[table["field"]] if "field" in table else None
        channels.append(Channel(name, indexed, table["kind"], unit, field))
    return channels


def _site(name: str, table: dict[str, Any]) -> Site:
    channels = tuple(
        channel for group in table.pop("channels") for channel in _site_channels(group)
    )
    return Site(name, channels=channels, **{"per_arm": True} | table)


def _seam(name: str, table: dict[str, Any]) -> Seam:
    channels = tuple(
        SeamChannel(channel, unit, group.get("site", name))
        for group in table.pop("channels")
        for channel, unit in _channel_units(group)
    )
    return Seam(name, channels=channels, **{"per_arm": True} | table)


def _signal(name: str, table: dict[str, Any]) -> Signal:
    names, linear = table.pop("names", ""), table.pop("linear", "")
    return Signal(
        name,
        channels=_NAMES.get(names, ()),
        units=(("insertion", linear),) if linear else (),
        together=(("tool", JOINTS[3:]),) if names == "joints" else (),
        against=tuple(table.pop("against", ())),
        **table,
    )


LAYERS: dict[str, str] = _TABLES["layers"]
"""Name of each layer, in the robot's order."""

PHASES: dict[str, str] = _TABLES["phases"]
"""Phases of an operation, each with when it is."""

CHECKS = {name: Check(name, **table) for name, table in _TABLES["checks"].items()}
"""Built-in checks in the order of the loop."""

CHECK_SEAMS: dict[str, str] = _TABLES["check_seams"]
"""Where a user's check may stand, in the order of the tick."""

SITES = {name: _site(name, table) for name, table in _TABLES["sites"].items()}
"""Where faults can strike, in the order of the tick."""

SEAMS = {name: _seam(name, table) for name, table in _TABLES["seams"].items()}
"""Every seam in the order of the tick."""

SIGNALS = tuple(_signal(name, table) for name, table in _TABLES["signals"].items())
"""What a monitor can look at, in the order of the tick."""
