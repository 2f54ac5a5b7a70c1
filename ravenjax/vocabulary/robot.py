"""Defines what a robot declares as data: the names in its campaign files and result tables.

Needs no JAX. The code of a robot (its tick, its sections of a campaign file, its time series) is
imported from its package only when it is needed.
"""

import dataclasses
import functools
import importlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.seams import Seam
from ravenjax.vocabulary.signals import Signal
from ravenjax.vocabulary.sites import Channel, ChannelRange, Site

OTHER_LAYER = "other"
"""Layer of a fault site that the robot does not declare."""


@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
    """The declaration of one robot."""

    name: str  # value of `[campaign] robot`
    title: str  # name for display
    package: str  # dotted name of the module or package with its code, for `part`
    arms: tuple[str, ...]  # all possible arms, in order
    joints: tuple[str, ...]  # joints of each arm, in order
    linear: tuple[str, ...]  # names of the joints that slide
    sites: Mapping[str, Site]  # in the order of the tick
    layers: Mapping[str, str]  # code of a site's layer -> name of the layer, in order
    checks: Mapping[str, Check]  # in the order of the loop
    run_levels: tuple[str, ...]  # names, by number
    live: str  # when the robot should follow the operator: the end of a sentence "... while"
    period_ms: int = 1  # duration of a tick
    leading_joints: tuple[int, ...] = ()  # lengths of vectors with only the first joints
    noise: tuple[str, ...] = ()  # parameters with the sizes of noise that `[campaign] noise` draws
    packet_cycles: str = ""  # parameter with the number of ms that a packet of the console lasts
    dead_man: str = ""  # switch that an operator must hold for the robot to move; "": none
    # comparisons of the robot's model with measurements, in sentences
    validation: str = "Its model has not been compared with measurements."
    tissue: bool = False  # True if there is tissue that a tip can enter
    # phases of an operation, with their definitions
    phases: Mapping[str, str] = dataclasses.field(default_factory=dict)
    # seams at which users' checks may act, with descriptions
    check_seams: Mapping[str, str] = dataclasses.field(default_factory=dict)
    # seams that `explain` compares, in the order of the tick
    seams: Mapping[str, Seam] = dataclasses.field(default_factory=dict)
    # (site, arm or "", channel) -> its normal range
    ranges: Mapping[tuple[str, str, str], ChannelRange] = dataclasses.field(default_factory=dict)
    # time series of a run -> path of its signal, see `stages.recorded`
    series: Mapping[str, str] = dataclasses.field(default_factory=dict)
    signals: tuple[Signal, ...] = ()  # signals that a user's check can use, in the tick's order
    hazards: str = ""  # folder with its hazard library, see `ravenjax.hazards`; "": none
    # optional stages of the tick for which a campaign file can ask, see `CampaignConfig.stages`
    stages: tuple[str, ...] = ()
    columns: tuple[Path, ...] = ()  # template with the columns of these stages, if they have any
    # Other files than Python modules that the robot's code reads, from models/ or from the folder
    # of its module. The hash of the code includes them
    files: tuple[str, ...] = ()

    @property
    def live_state(self) -> str:
        """Name of the state in which the robot follows the operator."""
        return f"{self.dead_man}-down" if self.dead_man else "live motion"

    def check(self, name: str) -> Check:
        """Return a check by name. An unknown name gives a check that raises an alarm."""
        return self.checks.get(name, Check(name, "1", "built-in check", "flag"))

    def with_checks(self, added: tuple[Check, ...]) -> "Robot":
        """Return the robot with users' checks before its built-in checks. If two checks trip in the
        same tick, the first of them is the cause.
        """
        return _extended(self, added) if added else self

    def with_channels(self, site: str, channels: tuple[Channel, ...]) -> "Robot":
        """Return the robot with these channels at a site, for a site without fixed channels."""
        return _extended(self, (), site, channels) if channels else self

    def layer(self, site: str) -> str:
        """Return a site's layer as text: usb_out -> "USB out, motors"; "other" if unknown."""
        return self.layers[self.sites[site].layer] if site in self.sites else OTHER_LAYER

    def normal_range(self, site: str, channel: str, arm: str) -> ChannelRange | None:
        """Return a channel's normal range, or None if the range is unknown. arm: name of an arm; it
        has no effect at a site that does not belong to an arm.
        """
        per_arm = site in self.sites and self.sites[site].per_arm
        return self.ranges.get((site, arm if per_arm else "", channel))

    def run_level(self, level: int) -> str:
        """Return the name of a run level; an unknown number is returned as a number."""
        return self.run_levels[level] if 0 <= level < len(self.run_levels) else str(level)

    def part(self, name: str) -> ModuleType:
        """Import and return the module `name` of the robot's package, or its single module."""
        package = importlib.import_module(self.package)
        # Only packages have this attribute.
        if not hasattr(package, "__path__"):
            return package
        return importlib.import_module(f"{self.package}.{name}")


@functools.lru_cache(maxsize=64)
def _extended(
    robot: Robot, added: tuple[Check, ...], site: str = "", channels: tuple[Channel, ...] = ()
) -> Robot:
    # Adds checks with new names, and replaces the channels of `site`.
    sites = dict(robot.sites)
    if site:
        sites[site] = dataclasses.replace(sites[site], channels=channels)
    checks = {**{check.name: check for check in added}, **robot.checks}
    return dataclasses.replace(robot, checks=checks, sites=sites)
