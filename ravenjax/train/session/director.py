"""Decides when hazards are armed: at times that the scenario draws, or at the instructor's command.

Only one hazard is active at a time. Planned times count from the beginning of the session's time:
the first pedal-down or the instructor's start.

A hazard that is due, or that the instructor has armed, waits until the session runs and the real
robot has followed the hands for `SETTLED_MS`. It also waits until `GAP_MS` after the last hazard.
It is disarmed after its time (`Armable.lasts_ms`), so that permanent faults end too. If lifting the
pedal is a right response, it is also disarmed once the pedal has been up for `CLEARED_MS`.
"""

from collections.abc import Sequence

import numpy as np

from ravenjax.train.protocol import REAL, RUNNING, Command, Frame
from ravenjax.train.robot import PEDAL_DOWN
from ravenjax.train.scenario import Armable

SETTLED_MS = 500
"""After this time in pedal-down the hands move. It is the library's earliest start."""
GAP_MS = 3000
"""Time between two hazards in which the tip comes to rest and the operator resumes the task."""

CLEARED_MS = 500
"""After this time with the pedal up the robot rests, and the hazard's effect is measured."""


class Director:
    """Schedules the hazards of one session."""

    def __init__(self, hazards: Sequence[Armable], seed: int) -> None:
        self.hazards = tuple(hazards)
        self.at_work = -1
        """Number of the hazard that is armed or active; -1: none."""
        rng = np.random.default_rng([seed, 3])
        planned = [
            (float(rng.uniform(*hazard.when_ms)), hazard.number)
            for hazard in self.hazards
            if hazard.when_ms is not None
        ]
        self.plan: list[tuple[float, int]] = sorted(planned)
        """(ms, number) of planned hazards still to come, in order."""
        self._pending = -1  # the instructor's next hazard
        self._ordered = False  # whether at_work has been armed
        self._since = 0  # tick at which it was armed
        self._free_from = 0
        self._down = 0  # ms of pedal-down so far
        self._up = 0  # ms since the pedal came up
        self._stop = False  # the instructor disarms the hazard

    def command(self, message: Command) -> None:
        """Take the instructor's "arm" or "disarm". Only one hazard can be armed at a time."""
        number = message.get("hazard")
        if message["do"] == "disarm":
            self._pending, self._stop = -1, True
        elif type(number) is int and 0 <= number < len(self.hazards) and not self._ordered:
            self._pending = number

    def step(self, tick: int, frame: Frame, clock: int) -> list[tuple[str, int]]:
        """Return the orders before this tick: "arm" or "disarm", and the number of the hazard.

        frame: of the last tick. clock: session's time.
        """
        number, pedal = frame.number, frame.number("pedal")
        ready = (
            number("phase") == RUNNING
            and number("view") == REAL
            and pedal
            and number("console_alive")
            and number("runlevel") == PEDAL_DOWN
            and not number("soft_estopped")
        )
        self._down = self._down + 1 if ready else 0
        self._up = 0 if pedal else self._up + 1
        if self._ordered:
            hazard = self.hazards[self.at_work]
            cleared = self._up >= CLEARED_MS and "release" in hazard.right_response
            if self._stop or cleared or tick - self._since >= hazard.lasts_ms:
                self.at_work, self._ordered, self._stop = -1, False, False
                self._free_from = tick + GAP_MS
                return [("disarm", hazard.number)]
            return []
        self._stop = False
        choice = self.at_work = self._pending  # the instructor's hazard first
        if choice < 0 and self.plan and self.plan[0][0] <= clock:
            choice = self.plan[0][1]
        if choice < 0 or self._down < SETTLED_MS or tick < self._free_from:
            return []
        if choice == self._pending:
            self._pending = -1
        else:
            self.plan.pop(0)
        self.at_work, self._ordered, self._since = choice, True, tick
        return [("arm", choice)]

    def reset(self, tick: int) -> None:
        """Forget the active hazard of a robot that was homed. Planned hazards stay."""
        self.at_work, self._ordered, self._pending, self._stop = -1, False, -1, False
        self._down, self._free_from = 0, tick + GAP_MS
