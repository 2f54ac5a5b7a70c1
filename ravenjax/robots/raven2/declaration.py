"""Reads the Raven-II's sites, seams, signals and checks from `declaration.toml`, without JAX."""

import csv
from pathlib import Path
from typing import Any

from ravenjax import resources
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import ARMS, JOINTS, LEADING_LENGTHS, SLIDING_JOINTS
from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.seams import Seam, SeamChannel
from ravenjax.vocabulary.signals import Signal
from ravenjax.vocabulary.sites import ARM, Channel, ChannelRange, Field, Site

_TABLES = resources.read_tables(__file__, "declaration.toml")
# Sets of channel names that the file can name
_NAME_SETS = {
    "joints": JOINTS,
    "positioning": JOINTS[:3],
    "axes": ("x", "y", "z"),
    "quaternion": ("qx", "qy", "qz", "qw"),
    "matrix": tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
}
_DEFAULTS: dict[str, Any] = {"per_arm": True}
_FIELDS = {name: Field(**field) for name, field in _TABLES["fields"].items()}


def _channels(table: dict[str, Any]) -> list[tuple[str, str, tuple[str | int, ...]]]:
    # Returns (name, unit, path) of each channel that a table of the file describes, such as
    # {names = "joints", unit = "rad", linear = "m", path = ["ARM", "#"]}. linear: unit of sliding
    # joints. path: indices from the signal to the number; "#" becomes the channel's index.
    names = table["names"]  # a list of names, or the name of a set
    is_set = str(names) in _NAME_SETS
    channels = []
    for index, name in enumerate(_NAME_SETS[names] if is_set else names):
        path = table.get("path", [ARM, "#"] if is_set else [name])
        steps = tuple(index if step == "#" else step for step in path)
        unit = table.get("linear", table["unit"]) if name in SLIDING_JOINTS else table["unit"]
        channels.append((name, unit, steps))
    return channels


def _site(name: str, table: dict[str, Any]) -> Site:
    # Returns a fault site from its table in declaration.toml. A row of `channels` describes one or
    # several channels. usual, pedal: their values without a fault, as in `Channel`.
    channels = []
    for row in table.pop("channels"):
        field, usual = _FIELDS.get(row.get("field")), row.get("usual")
        pedal = tuple(row.get("pedal", ()))
        for channel, unit, path in _channels(row):
            channels.append(Channel(channel, path, row["kind"], unit, field, usual, pedal))
    return Site(name, channels=tuple(channels), **_DEFAULTS | table)


def _seam(name: str, table: dict[str, Any]) -> Seam:
    # Returns a seam from its table in declaration.toml.
    channels = tuple(
        SeamChannel(channel, unit, row.get("site", name), path)
        for row in table.pop("channels")
        for channel, unit, path in _channels(row)
    )
    table["present"] = tuple(table.get("present", ()))
    return Seam(name, channels=channels, **_DEFAULTS | table)


def _signal(name: str, table: dict[str, Any]) -> Signal:
    # Returns a recorded signal from its table in declaration.toml. The table of jpos contains names
    # = "joints", unit = "rad", linear = "m" and against = ["jpos_d", "model_jpos"]. names: key of
    # _NAME_SETS. linear: unit of the insertion. against: signals with similar values.
    names, linear_unit = table.pop("names", ""), table.pop("linear", "")
    return Signal(
        name,
        channels=_NAME_SETS.get(names, ()),
        units=(("insertion", linear_unit),) if linear_unit else (),
        # One score for the four joints of the tool
        together=(("tool", JOINTS[3:]),) if names == "joints" else (),
        against=tuple(table.pop("against", ())),
        **table,
    )


RANGES = Path(__file__).with_name("normal_ranges.csv")
"""File with the normal range of each fault channel, from runs of every generated motion at the
teleoperation scales 0.05 and 0.1, in which no check trips.
"""
LAYERS: dict[str, str] = _TABLES["layers"]
"""Name of each layer, in the robot's order."""
CHECKS = {name: Check(name, **table) for name, table in _TABLES["checks"].items()}
"""Built-in checks in the order of the loop."""
SITES = {name: _site(name, table) for name, table in _TABLES["sites"].items()}
"""Fault sites, in the order of the tick."""
SEAMS = {name: _seam(name, table) for name, table in _TABLES["seams"].items()}
"""Every seam, in the order of the tick."""


def _read_ranges() -> dict[tuple[str, str, str], ChannelRange]:
    # Returns the normal range of (site, arm, channel), from analysis/normal_ranges/measure.py.
    with open(RANGES, encoding="utf-8", newline="") as file:
        _, *rows = csv.reader(file)  # without the header
    return {
        (site, arm, channel): ChannelRange(site, arm, channel, unit, *map(float, numbers))
        for site, arm, channel, unit, *numbers in rows
    }


# The other fields of `Robot`, with a tuple for each list of the file
_ROBOT: dict[str, Any] = {
    key: tuple(x) if isinstance(x, list) else x for key, x in _TABLES["robot"].items()
}
ROBOT = Robot(
    package=str(__package__),
    arms=ARMS,
    joints=JOINTS,
    linear=SLIDING_JOINTS,
    leading_joints=LEADING_LENGTHS,
    run_levels=run_levels.NAMES,
    sites=SITES,
    layers=LAYERS,
    checks=CHECKS,
    phases=_TABLES["phases"],
    check_seams=_TABLES["check_seams"],
    seams=SEAMS,
    ranges=_read_ranges(),
    series=_TABLES["series"],
    hazards=str(Path(__file__).with_name("hazards")),
    columns=(Path(__file__).with_name("columns.csv.j2"),),
    signals=tuple(_signal(name, table) for name, table in _TABLES["signals"].items()),
    **_ROBOT,
)
