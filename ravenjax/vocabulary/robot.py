"""What a robot declares of itself, without JAX: what a campaign file may name, and what a result
table calls it.

Everything else of a robot (its tick, its sections of a campaign file, its time series) is code, and
is imported from its package only where it is needed.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
from collections.abc import Mapping
from types import ModuleType

from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.seams import Seam
from ravenjax.vocabulary.signals import Signal
from ravenjax.vocabulary.sites import Site

OTHER_LAYER = "other"
"""Layer of a site that a robot does not declare."""


@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
    """One kind of robot."""

    name: str  # as `[campaign] robot` takes it
    title: str  # in words
    package: str  # dotted name of the module, or package, that holds its code: `part` looks there
    arms: tuple[str, ...]  # every one it can have, in mechanism order
    joints: tuple[str, ...]  # of each arm, in order
    linear: tuple[str, ...]  # those of the joints that slide
    sites: Mapping[str, Site]  # in the order of its tick
    layers: Mapping[str, str]  # code of a site's layer -> its name, in order
    checks: Mapping[str, Check]  # in the order of its loop
    run_levels: tuple[str, ...]  # by number
    live: str  # when the robot should do what the operator asks for: continues "while"
    leading_joints: tuple[int, ...] = ()  # lengths of vectors that are of the first joints only
    noise: tuple[str, ...] = ()  # parameters: the sizes of what `[campaign] noise` draws
    packet_cycles: str = ""  # parameter: how many milliseconds a packet of the console lasts
    dead_man: str = (
        ""  # the switch that an operator holds down while the robot is to move; "": it has none
    )
    tissue: bool = False  # whether there is tissue that a tip can go into
    phases: Mapping[str, str] = dataclasses.field(
        default_factory=dict
    )  # of an operation, and when each is
    check_seams: Mapping[str, str] = dataclasses.field(
        default_factory=dict
    )  # where checks of one's own may stand
    seams: Mapping[str, Seam] = dataclasses.field(
        default_factory=dict
    )  # where `explain` looks, in the tick's order
    # what a check of one's own can be built on, in the tick's order
    signals: tuple[Signal, ...] = ()
    # what its code reads beside Python modules, from models/ or beside its own module: the files
    # count in a result's identity
    files: tuple[str, ...] = ()

    @property
    def live_state(self) -> str:
        """Being live, in a word."""
        return f"{self.dead_man}-down" if self.dead_man else "live motion"

    def check(self, name: str) -> Check:
        """A check by name; one that this version does not know flags."""
        return self.checks.get(name, Check(name, "1", "built-in check", "flag"))

    def with_checks(self, own: tuple[Check, ...]) -> Robot:
        """The robot with users' checks before the built-in ones. Of two that trip together the
        first is the cause.
        """
        return _with_checks(self, own) if own else self

    def layer(self, site: str) -> str:
        """A site's layer in words: usb_out -> "USB out, motors"; "other" for a site that it does
        not declare.
        """
        return self.layers[self.sites[site].layer] if site in self.sites else OTHER_LAYER

    def run_level(self, level: int) -> str:
        """The name of a run level; an unknown number stays a number."""
        return self.run_levels[level] if 0 <= level < len(self.run_levels) else str(level)

    def part(self, name: str) -> ModuleType:
        """A part of its code: the module `name` of its package, or the package itself where that
        has none.
        """
        whole = importlib.import_module(self.package)
        return (
            importlib.import_module(f"{self.package}.{name}")
            if hasattr(whole, "__path__")
            else whole
        )


@functools.lru_cache(maxsize=64)
def _with_checks(robot: Robot, own: tuple[Check, ...]) -> Robot:
    return dataclasses.replace(
        robot, checks={**{check.name: check for check in own}, **robot.checks}
    )
