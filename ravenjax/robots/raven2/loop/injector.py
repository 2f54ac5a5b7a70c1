"""Injects faults at the fault sites of the Raven-II's tick.

A fault at a rotation matrix changes the quaternion of the rotation. `RavenSetup.dac_words` decides
whether a DAC command that is too large for the USB word wraps, saturates or keeps its value.
"""

from functools import cache, reduce
from operator import ne, or_
from typing import Any

from ravenjax.faults import fault, injection
from ravenjax.numbers import Scalar, narrow_numbers, where, widen_numbers
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.geometry.mapping import matrix_from_quat, quat_from_matrix
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.sites import PARAMETER


class RavenInjector(injection.Injector):
    """Injects faults in one tick of a Raven-II; `inject(site, signal)` is the faulty signal."""

    def __init__(
        self,
        setup: RavenSetup,
        faults: fault.Faults,
        state: fault.FaultState,
        clock: fault.TriggerClocks,
    ):
        super().__init__(setup, _channel_targets(setup), faults, state, clock)

    def __call__(self, site: str, signal: Any, present: Scalar = True) -> Any:
        # Returns the signal after the faults at `site`. present: whether the signal exists in this
        # tick, bool. Rotations are changed as quaternions.
        if site in ROTATIONS and self.injects_at(site):
            quats = tuple(
                quat_from_matrix(widen_numbers(self.setup, rotation)) for rotation in signal
            )
            faulty_quats = super().__call__(site, quats, present)
            rotations = []
            for rotation, quat, faulty_quat in zip(signal, quats, faulty_quats, strict=True):
                # Without a fault, the rotation keeps its bits, which a conversion could change
                changed = reduce(or_, quat.map(ne, faulty_quat))
                faulty_rotation = narrow_numbers(self.setup, matrix_from_quat(faulty_quat))
                rotations.append(where(changed, faulty_rotation, rotation))
            return tuple(rotations)
        return super().__call__(site, signal, present)


def seeds_network(setup: RavenSetup, channel: str) -> bool:
    """Return whether faults may set the seed of network losses ("bursts") or delays ("jitter")."""
    return ("network", "", channel) in setup.injection.channels


def may_restart(site: str, arm: str, channel: str) -> bool:
    """Return whether a fault on a channel, of any arm, may start a robot that has stopped."""
    sites = ("runlevel", "pins_out", "plc", "buttons", "usb_status", PARAMETER)
    return site in sites or channel == "pins"


ROTATIONS = ("ori", "ori_d")
"""Sites whose signal consists of rotation matrices; faults act on their quaternions."""


@cache
def _channel_targets(setup: RavenSetup) -> dict[injection.ChannelKey, injection.Target]:
    """Return channel -> path and type of its number. `setup.dac_words` sets the type at usb_out."""
    word_types = {"wrap": "int16", "saturate": "int16 saturated", "unwrapped": "int32"}
    return {
        # key[0] is the site
        key: (path, word_types[setup.dac_words] if key[0] == "usb_out" else kind)
        for key, (path, kind) in injection.channel_paths(ROBOT, setup).items()
    }
