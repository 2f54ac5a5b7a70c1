"""Faults at the seams of the tick: which channel of which site they strike, and how that stores what they leave."""

from __future__ import annotations

from functools import cache, reduce
from typing import Any

from ravenjax.faults import fault, injection, window
from ravenjax.numbers.setup import narrow, wide
from ravenjax.numbers.vec import Scalar, Vec, where
from ravenjax.robots.raven2.geometry.mapping import matrix_from_quat, quat_from_matrix
from ravenjax.robots.raven2.setup import Setup
from ravenjax.robots.raven2.sites import SITES
from ravenjax.vocabulary.sites import ARM


class Injector:
    """`inject(site, signal)` for one tick, carrying the faults' state from site to site."""

    def __init__(self, setup: Setup, faults: fault.Faults, state: fault.State, clock: window.Clock) -> None:
        self.setup, self.faults, self.state, self.clock = setup, faults, state, clock

    def __call__(self, site: str, signal: Any, present: Scalar = True) -> Any:
        if site in ROTATIONS and self.strikes(site):
            quats = tuple(quat_from_matrix(wide(self.setup, rotation)) for rotation in signal)
            struck = self._inject(site, quats, present)
            return tuple(_rotated(self.setup, *of_arm) for of_arm in zip(signal, quats, struck, strict=True))
        return self._inject(site, signal, present)

    def _inject(self, site: str, signal: Any, present: Scalar) -> Any:
        self.state, signal = injection.inject(
            self.setup, _paths(self.setup), self.faults, self.state, self.clock, site, signal, present
        )
        return signal

    def strikes(self, *sites: str) -> bool:
        """Whether the campaign hits any of these sites."""
        return strikes(self.setup, *sites)


ROTATIONS = ("ori", "ori_d")
"""Sites whose signal is rotation matrices, struck as quaternions."""


def _rotated(setup: Setup, rotation: Vec, quat: Vec, struck: Vec) -> Vec:
    """The rotation of a quaternion that a fault changed; one that none changed keeps every bit of its matrix."""
    changed = reduce(lambda a, b: a | b, quat.map(lambda before, after: before != after, struck))
    return where(changed, narrow(setup, matrix_from_quat(struck)), rotation)


def strikes(setup: Setup, *sites: str) -> bool:
    """Whether the campaign hits any of these sites."""
    return any(use.site in sites for use in setup.injection.sites)


@cache
def _paths(setup: Setup) -> dict[injection.ChannelKey, tuple[injection.Path, str]]:
    """Where each channel that the campaign hits stands in its site's signal."""
    found = {}
    for site, arm, name in injection.channel_keys(setup):
        channel = SITES[site].channel(name)
        path = tuple(setup.arms.index(arm) if step == ARM else step for step in channel.path)
        kind = _STORED[setup.dac_words] if site == "usb_out" else channel.kind
        found[site, arm, name] = (path, kind)
    return found


_STORED = {"wrap": "int16", "saturate": "int16 saturated", "unwrapped": "int32"}
"""`Setup.dac_words` as the number that the USB hook stores."""
