"""Defines a frame: one millisecond of a session as a row of named float32 numbers.

The page, the recording and the judge read frames. `channels.toml` lists the names. Whole numbers
stay below 2^24, which float32 holds exactly: four and a half hours of ticks. Lengths are m and
angles rad unless a suffix says otherwise. `tip`, `position` and `force` are in the arm's frame 0.

*Live*, *unintended motion*, *loss of motion*, *false report* and *golden run* are defined in
`ravenjax.outcomes`. The distances are those of `ravenjax.stages.monitor`; the largest of a run is
the result table's column of that name. The golden run restarts from the robot's state whenever a
hazard is armed.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Callable, Sequence
from importlib import resources
from typing import Any

import numpy as np

from ravenjax.train.robot import ArmName, Arms

CHANNELS: dict[str, dict[str, int]] = tomllib.loads(
    resources.files("ravenjax.train.protocol").joinpath("channels.toml").read_text(encoding="utf-8")
)
"""Channels of the tick (`simulated`) and of the session, with the number of values of each."""
GOLDEN = ("golden_halted_ms", "golden_cue")
"""Channels of the golden run. They are neighbours in a row."""


PHASES = ("ready", "running", "paused", "stopped", "over", "lost")
"""Phases of a session.

ready: waiting for the first pedal-down; running; paused by the instructor; stopped: the robot's
E-stop; over; lost: no reports arrive, and the robot's state is unknown.
"""
READY, RUNNING, PAUSED, STOPPED, OVER, LOST = range(len(PHASES))
CONSOLES = ("nobody", "page", "itp", "script", "crtk")
"""What may drive: nobody, the operator's page, ITP or CRTK over the network, or a script."""
VIEWS = ("real", "virtual", "replay")
"""What follows the hand.

real: the robot; virtual: only the virtual robot, while the robot rests; replay: the robot, which
repeats the tried motion.
"""
REAL, VIRTUAL, REPLAY = range(len(VIEWS))


@dataclasses.dataclass(frozen=True)
class FrameLayout:
    """The place of each channel in a row."""

    arms: Arms
    places: dict[str, slice]
    size: int

    @staticmethod
    def of(arms: Sequence[ArmName]) -> FrameLayout:
        """Return the layout for these arms: the tick's channels first, the session's after them."""
        places: dict[str, slice] = {}
        at = 0
        for source in ("simulated", "session"):
            each = CHANNELS[f"{source}_arm"].items()
            named = CHANNELS[source] | {
                f"{arm}/{name}": size for arm in arms for name, size in each
            }
            for name, size in named.items():
                places[name] = slice(at, at + size)
                at += size
        return FrameLayout(tuple(arms), places, at)

    def of_channels(self, keeps: Callable[[str], bool]) -> FrameLayout:
        """Return the layout of a row that has only some channels, in the same order."""
        places: dict[str, slice] = {}
        size = 0
        for name, place in self.places.items():
            if keeps(name):
                places[name] = slice(size, size + place.stop - place.start)
                size = places[name].stop
        return FrameLayout(self.arms, places, size)

    @property
    def simulated(self) -> int:
        """The number of values that the tick fills."""
        return self.places["session_tick"].start

    def names(self) -> list[str]:
        """Return a name for each number: `gold/jpos/0`, or `runlevel` for a single one."""
        return [
            name if place.stop - place.start == 1 else f"{name}/{i}"
            for name, place in self.places.items()
            for i in range(place.stop - place.start)
        ]


class Frame:
    """A row, read by names: `frame["gold/tip"]` is an array, `frame.number("runlevel")` a number.

    `numbers` is the same row as Python floats, for readers of many single numbers. Writing by name
    changes both. After filling the row directly, call `settle()`.
    """

    __slots__ = ("layout", "numbers", "row")

    def __init__(self, layout: FrameLayout, row: np.ndarray | None = None) -> None:
        """row: float32 [layout.size]; zeros if left out."""
        self.layout = layout
        self.row = np.zeros(layout.size, np.float32) if row is None else row
        self.numbers: list[float] = []
        self.settle()

    def settle(self) -> None:
        """Copy the row into `numbers`."""
        self.numbers = self.row.tolist()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.row[self.layout.places[name]]

    def __setitem__(self, name: str, value: Any) -> None:
        place = self.layout.places[name]
        self.row[place] = value
        self.numbers[place] = self.row[place].tolist()

    def number(self, name: str) -> float:
        """Return the value of a channel with a single number."""
        return float(self.row[self.layout.places[name].start])
