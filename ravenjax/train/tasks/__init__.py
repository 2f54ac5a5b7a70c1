"""The operator's tasks: reach targets (also in levels), transfer an object, follow a line, or none.

All positions are in world coordinates, m. A task lies around the middle of the tips' start
positions. Tips in a frame are in frame 0 of their arm. Tasks do not affect the robot: pegs and
objects stay in place, without contact.
"""

from collections.abc import Mapping

from ravenjax.train.protocol.world import Point, to_world
from ravenjax.train.robot import ArmName
from ravenjax.train.scenario import Scenario
from ravenjax.train.scenario.config import Levels, Path, PegTransfer, Reach
from ravenjax.train.tasks.base import Field, Task
from ravenjax.train.tasks.path import PathTask
from ravenjax.train.tasks.pegs import PegTask
from ravenjax.train.tasks.targets import LevelsTask, ReachTask

__all__ = ["Task", "make_task"]


def make_task(scenario: Scenario, tips: Mapping[ArmName, Point], seed: int) -> Task:
    """Return the task of a session. tips: where the tips begin, m, frame 0 of their arm."""
    settings = scenario.task
    arms = settings.arms or scenario.arms
    begin: dict[ArmName, Point] = {arm: to_world(arm, tips[arm]) for arm in scenario.arms}
    x, y = (sum(begin[arm][axis] for arm in arms) / len(arms) for axis in (0, 1))
    field = Field(tuple(arms), begin, (x, y), seed)
    match settings:
        case Reach():
            return ReachTask(settings, field)
        case PegTransfer():
            return PegTask(settings, field)
        case Path():
            return PathTask(settings, field)
        case Levels():
            return LevelsTask(settings, field)
        case _:
            return Task("free", field)
