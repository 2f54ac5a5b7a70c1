"""How fast the hands go, and whether they have slowed down.

Hands also slow down where they arrive, so a slow-down counts only if it lasts: longer than a tip is
held at a target. Its time is that of its beginning.
"""

from __future__ import annotations

import math

SLOW_SHARE = 0.25
"""Of the usual speed before the hazard struck; `stages.reaction` has operators slow down to it."""
SLOW_FOR_MS = 1000
"""As long, without a break, before it counts."""
MOVING_MM_S = 2.0
"""Slower hands, as tip motion, have nothing to slow down."""
# 1/ms, of running means: over some targets, over a twitch.
_USUAL, _PRESENT = 1.0 / 2000.0, 1.0 / 50.0
_QUICK, _SLOW_AT_STRIKE = -1, -2


class SlowdownDetector:
    """Running means of the hands' speed as tip motion, mm/s, both hands together."""

    __slots__ = ("_before", "_limit", "_scale", "_since", "present", "slowed", "usual")

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._before: list[float] | None = None
        self.usual = self.present = 0.0
        # mm/s; the hands are slow below it.
        self._limit = 0.0
        # The tick since which they are slow.
        self._since = _QUICK
        self.slowed = -1
        """Tick in which a slow-down that lasts began; -1: there is none."""

    def step(self, tick: int, hands: list[float]) -> None:
        """hands: um before scaling, three numbers a hand; once a tick."""
        before, self._before = self._before, hands
        if before is None:
            return
        # um/ms is mm/s
        speed = self._scale * math.dist(hands, before)
        self.usual += _USUAL * (speed - self.usual)
        self.present += _PRESENT * (speed - self.present)
        if self.present >= self._limit:
            self._since, self.slowed = _QUICK, -1
        elif self._since == _QUICK:
            self._since = tick
        elif self._since >= 0 and tick - self._since >= SLOW_FOR_MS:
            self.slowed = self._since

    def strike(self) -> None:
        """From now on slowing down is measured against the speed of now."""
        self._limit = SLOW_SHARE * self.usual if self.usual > MOVING_MM_S else 0.0
        self._since = _SLOW_AT_STRIKE if self.present < self._limit else _QUICK
        self.slowed = -1

    def jump(self) -> None:
        """The hands were put elsewhere."""
        self._before = None
