"""One millisecond of a session as a row of float32 numbers with names: what page, recording and
judge read. `channels.toml` lists the names.

Whole numbers among them stay below 2^24, which float32 holds exactly: four and a half hours of
ticks. Lengths are m and angles rad where no suffix says otherwise; `tip`, `position` and `force`
are in the arm's frame 0.

*Live*, *unintended motion*, *loss of motion*, *false report* and *golden run* mean what
`ravenjax.outcomes` says; the distances are those of `ravenjax.stages.monitor`, and the largest of a
run is the result table's column of that name. The golden run restarts from the robot's
state whenever a hazard is armed.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Sequence
from importlib import resources
from typing import Any

import numpy as np

from ravenjax.train.robot import ArmName

CHANNELS: dict[str, dict[str, int]] = tomllib.loads(
    resources.files("ravenjax.train.protocol").joinpath("channels.toml").read_text(encoding="utf-8")
)
"""Channels of the tick (`simulated`) and of the session by name, and how many numbers each has."""
GOLDEN = ("golden_halted_ms", "golden_cue")
"""Channels of the golden run; they are neighbours in a row."""


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
        for source in ("simulated", "session"):
            each = CHANNELS[f"{source}_arm"].items()
            named = CHANNELS[source] | {
                f"{arm}/{name}": size for arm in arms for name, size in each
            }
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
