"""One millisecond of a session as a row of float32 numbers with names: what page, recording and
judge read.

Whole numbers among them stay below 2^24, which float32 holds exactly: four and a half hours of
ticks. Lengths are m and angles rad where no suffix says otherwise; `tip`, `position` and `force`
are in the arm's frame 0.

*Live*, *unintended motion*, *loss of motion*, *false report* and *golden run* mean what
`ravenjax.outcomes` says; the distances are those of `ravenjax.stages.monitor`, and the largest of a
run is the result table's column of that name. The golden run begins anew whenever a hazard is
armed, where the robot then is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.robots.raven2.arms import ArmName

SIMULATED = {
    "tick": 1,  # ms of the robot since it was switched on
    "runlevel": 1,  # 0 E-stop, 1 init, 2 pedal up, 3 pedal down
    "surgeon_mode": 1,  # 1: the robot has heard that the pedal is down
    "soft_estopped": 1,  # 1: the software holds its E-stop
    "live": 1,  # 1: run level pedal-down without a software E-stop, at the end of the tick
    "plc_runlevel": 1,
    "brakes": 1,  # 1: on
    "last_seq": 1,  # number of the last packet taken
    "fault_active": 1,  # 1: a fault is at work in this tick
    "trips": 1,  # how often the robot's own checks have tripped so far, all together
    "tip_distance_mm": 1,  # between the arms' tips; infinite with one arm
    "halted_ms": 1,  # how long so far the pedal was held down and the robot was not live
    "golden_halted_ms": 1,  # the golden run's
    "golden_cue": 1,  # 1: the cue pulls in the golden run
}
"""Channels that the robot's tick fills, and how many numbers each has."""

GOLDEN = ("golden_halted_ms", "golden_cue")
"""Those that tell of the golden run; neighbours."""

SIMULATED_ARM = {
    "jpos": 7,  # joints as the control software measures them
    "jpos_d": 7,  # and as it wants them
    "mpos": 7,  # motors as measured, rad
    "mvel": 7,  # as the control software estimates, rad/s
    "link_jpos": 7,  # where the links truly are
    "model_jpos": 7,  # of the nominal model, the ghost
    "tip": 3,  # where the tip truly is
    "model_tip": 3,
    "position": 3,  # tip as measured
    "error_mm": 1,  # of the measured tip from the nominal model's
    # of the haptic cue, device units, as the operator's hand would feel it with the cue on
    "force": 3,
    "dac": 7,  # counts that the motors get
    "depth_mm": 1,  # of the tip below the tissue's surface, negative above
    # of the true tip from golden run, nominal model and standing still, the nearest; live, else 0
    "unintended_mm": 1,
    # of the true tip from golden run and standing still, the nearer; while not live, else 0
    "unintended_off_mm": 1,
    # of the true tip from golden run and model, the nearer, by motion that it missed; live, else 0
    "loss_mm": 1,
    # of the measured tip from the true one, beyond the golden run's; live; NaN: not known
    "false_report_mm": 1,
    # of the measured tip from the golden run's: what a computer could know, and a person from 1 mm
    # on
    "known_mm": 1,
    # N on the instrument, of tissue, vessel and the other instrument; 0 without [contact]
    "contact": 3,
    "vessel_n": 1,  # of the vessel alone
    "between_n": 1,  # of the other instrument alone
}
"""The same of each arm."""

SESSION = {
    "session_tick": 1,  # ms since the session began, pauses left out
    # until the session's time is up; all of it before the first pedal-down or the instructor's
    # start
    "left_ms": 1,
    "phase": 1,  # number of `PHASES`
    "view": 1,  # number of `VIEWS`
    "pedal": 1,  # 1: the operator holds it down
    "console_alive": 1,  # 0: input is stale; pedal up and no force then
    "console": 1,  # number of `CONSOLES`: who drives
    "link": 1,  # 0: nothing is heard of the robot
    # number of the hazard in the session's list of hazards that is armed or at work; -1: none
    "hazard": 1,
    "target": 1,  # number of the task's present goal; -1: none
    "progress": 1,  # of the task, 0 to 1
    "cue_on": 1,  # 1: the force is felt
    "compute_us": 1,  # of the tick before
    "lateness_us": 1,  # of the start of the tick before
    "late_ticks": 1,  # so far
}
"""Channels that the session fills."""

SESSION_ARM = {
    "hand": 3,  # um, the operator's hand before scaling, ITP frame
    "hand_quat": 4,  # x, y, z, w
    "grasp": 1,  # mrad, positive closes
    # of the robot that is tried in place of the real one; link_jpos where there is none
    "virtual_jpos": 7,
    "virtual_tip": 3,
}

PHASES = ("ready", "running", "paused", "stopped", "over", "lost")
"""Waiting for the first pedal; at work; paused by the instructor; the robot's E-stop; ended;
nothing is heard of the robot, and nobody can say what it does."""
CONSOLES = ("nobody", "page", "itp", "script", "crtk")
"""Who may drive: the page's operator window, a console over the network, a scripted or recorded
operator, a console over ROS."""
VIEWS = ("real", "virtual", "replay")
"""Who follows the hand: the robot; the virtual robot alone (the robot rests); the robot, with
what was tried.
"""


@dataclasses.dataclass(frozen=True)
class FrameLayout:
    """Where each channel stands in a row."""

    arms: tuple[ArmName, ...]
    places: dict[str, slice]
    size: int

    @staticmethod
    def of(arms: Sequence[ArmName]) -> FrameLayout:
        """The layout of a session with these arms: the tick's channels first, the session's
        after them.
        """
        places: dict[str, slice] = {}
        at = 0
        for common, each in ((SIMULATED, SIMULATED_ARM), (SESSION, SESSION_ARM)):
            named = common | {f"{arm}/{name}": size for arm in arms for name, size in each.items()}
            for name, size in named.items():
                places[name] = slice(at, at + size)
                at += size
        return FrameLayout(tuple(arms), places, at)

    @property
    def simulated(self) -> int:
        """How many numbers the tick fills."""
        return self.places["session_tick"].start

    def names(self) -> list[str]:
        """A name for each number: `gold/jpos/0` and so on, without a number where a channel has
        one only.
        """
        return [
            name if place.stop - place.start == 1 else f"{name}/{i}"
            for name, place in self.places.items()
            for i in range(place.stop - place.start)
        ]


class Frame:
    """A row, by names: `frame["gold/tip"]` is an array, `frame.number("runlevel")` a number.

    `numbers` is the same row as Python has numbers, for those who look at many one by one. Writing
    by names changes both; who has filled the row itself calls `settle()`.
    """

    __slots__ = ("layout", "numbers", "row")

    def __init__(self, layout: FrameLayout, row: np.ndarray | None = None) -> None:
        """row: float32 [layout.size]; zeros if left out."""
        self.layout = layout
        self.row = np.zeros(layout.size, np.float32) if row is None else row
        self.numbers: list[float] = []
        self.settle()

    def settle(self) -> None:
        """Take the row over into `numbers`."""
        self.numbers = self.row.tolist()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.row[self.layout.places[name]]

    def __setitem__(self, name: str, value: Any) -> None:
        place = self.layout.places[name]
        self.row[place] = value
        self.numbers[place] = self.row[place].tolist()

    def number(self, name: str) -> float:
        """The number of a channel that has one."""
        return float(self.row[self.layout.places[name].start])
