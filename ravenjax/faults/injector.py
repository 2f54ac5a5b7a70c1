"""Faults at the seams of a tick: `inject(site, signal)`, carrying the faults' state from site to
site.
"""

from __future__ import annotations

import functools
from typing import Any

from ravenjax.faults import fault, injection, window
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import ARM


class Injector:
    """`inject(site, signal)` for one tick of a robot."""

    def __init__(
        self,
        robot: Robot,
        setup: Setup,
        faults: fault.Faults,
        state: fault.FaultState,
        clock: window.TriggerClocks,
    ) -> None:
        self.setup: Any = setup  # the robot's own
        self.robot, self.faults, self.state, self.clock = robot, faults, state, clock

    def __call__(self, site: str, signal: Any, present: Scalar = True) -> Any:
        """The signal of a site as the faults leave it, where it is `present`."""
        self.state, signal = injection.inject(
            self.setup, self.paths(), self.faults, self.state, self.clock, site, signal, present
        )
        return signal

    def strikes(self, *sites: str) -> bool:
        """Whether the campaign hits any of these sites."""
        return strikes(self.setup, *sites)

    def paths(self) -> dict[injection.ChannelKey, injection.Target]:
        """Where each channel that the campaign hits stands in its site's signal."""
        return paths(self.robot, self.setup)


def strikes(setup: Setup, *sites: str) -> bool:
    """Whether the campaign hits any of these sites."""
    return any(use.site in sites for use in setup.injection.sites)


@functools.cache
def paths(robot: Robot, setup: Setup) -> dict[injection.ChannelKey, injection.Target]:
    """Where each channel that the campaign hits stands in its site's signal, as the robot
    declares it.
    """
    table = {}
    for site, arm, name in injection.channel_keys(setup):
        channel = robot.sites[site].channel(name)
        path = tuple(setup.arms.index(arm) if step == ARM else step for step in channel.path)
        table[site, arm, name] = (path, channel.kind)
    return table
