"""Decides when hazards become active: at times that the scenario draws, or at the instructor's
command. One at a time.

Planned times count from the beginning of the session's time, the first pedal-down or the
instructor's start.

A hazard that is due, or that the instructor has armed, waits until it can teach something: the
session runs, the real robot follows the hands, the pedal has been down for `SETTLED_MS`, no other
hazard is at work and the last one is `GAP_MS` past. It is taken back after its time
(`Armable.lasts_ms`), so that permanent faults end too; and once the pedal has been up for
`CLEARED_MS` if lifting it is a right response. The next pedal-down then continues normally.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from ravenjax.train.protocol.frame import PHASES, VIEWS, Frame
from ravenjax.train.robot import PEDAL_DOWN
from ravenjax.train.scenario import Armable, Scenario

SETTLED_MS = 500
"""Pedal-down is adopted and the hands move: what the library takes as its earliest start in
pedal-down.
"""
GAP_MS = 3000
"""Between two hazards: the tip has come to rest and the operator has taken up the task again."""

CLEARED_MS = 500
"""The robot has come to rest in its brakes, and what the hazard did is measured."""

_RUNNING, _REAL = PHASES.index("running"), VIEWS.index("real")


class Order(NamedTuple):
    """What the session is to do before this tick."""

    kind: Literal["arm", "disarm"]
    number: int  # in the session's list of hazards


class Director:
    """The hazards of one session."""

    def __init__(self, scenario: Scenario, hazards: Sequence[Armable], seed: int) -> None:
        self.hazards = tuple(hazards)
        self.at_work = -1
        """Number of the hazard that is armed or at work; -1: none."""
        rng = np.random.default_rng([seed, 3])
        planned = [
            (float(rng.uniform(*hazard.when_ms)), hazard.number)
            for hazard in self.hazards
            if hazard.when_ms is not None
        ]
        self.plan: list[tuple[float, int]] = sorted(planned)
        """(ms, number) of what is yet to come by itself, in order."""
        self._pending = -1  # the instructor's
        self._ordered = False  # at_work has been armed
        self._since = 0  # tick of that
        self._free_from = 0
        self._down = 0  # ms of pedal-down so far
        self._up = 0  # ms since the pedal came up
        self._stop = False  # the instructor takes it back

    def command(self, message: Mapping[str, Any]) -> None:
        """The instructor's "arm" or "disarm". While a hazard is at work no other can be armed."""
        number = message.get("hazard")
        if message["do"] == "disarm":
            self._pending, self._stop = -1, True
        elif type(number) is int and 0 <= number < len(self.hazards) and not self._ordered:
            self._pending = number

    def step(self, tick: int, frame: Frame, clock: int | None = None) -> tuple[Order, ...]:
        """What is to be done before this tick, `frame` being that of the tick before.

        clock: ms since the session's time began; the tick if None.
        """
        number, pedal = frame.number, frame.number("pedal")
        ready = (
            number("phase") == _RUNNING
            and number("view") == _REAL
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
                return (Order("disarm", hazard.number),)
            return ()
        self._stop = False
        choice = self.at_work = self._pending  # the instructor's hazard first
        if choice < 0 and self.plan and self.plan[0][0] <= (tick if clock is None else clock):
            choice = self.plan[0][1]
        if choice < 0 or self._down < SETTLED_MS or tick < self._free_from:
            return ()
        if choice == self._pending:
            self._pending = -1
        else:
            self.plan.pop(0)
        self.at_work, self._ordered, self._since = choice, True, tick
        return (Order("arm", choice),)

    def reset(self, tick: int) -> None:
        """The robot was homed again and holds no fault any more; what is yet to come stays."""
        self.at_work, self._ordered, self._pending, self._stop = -1, False, -1, False
        self._down, self._free_from = 0, tick + GAP_MS
