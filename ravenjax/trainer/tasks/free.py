"""Nothing is asked: look around, feel the robot."""

from __future__ import annotations

from collections.abc import Mapping

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.trainer.protocol.frame import Frame
from ravenjax.trainer.protocol.world import Point
from ravenjax.trainer.tasks.base import Event, Task


class FreeTask(Task):
    """No goal, never done."""

    def __init__(self, begin: Mapping[ArmName, Point]) -> None:
        super().__init__("free", begin)

    def _step(self, frame: Frame, tips: Mapping[ArmName, Point], tick: int, events: list[Event]) -> None:
        """Nothing to do."""
