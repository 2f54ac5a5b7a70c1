"""CRTK as a console of a robot's realtime loop: a process beside it speaks, the loop looks into
shared memory.
"""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train import processes
from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.robot_link.crtk import bridge
from ravenjax.train.robot_link.crtk.exchange import LoopEnd
from ravenjax.train.robot_link.crtk.messages import Ros
from ravenjax.train.session.blueprint import Blueprint

_LOOK_EVERY = 256
"""Calls of `poll` between two looks whether the process is still there: each is a system call."""


class RobotTraits(NamedTuple):
    """What `spawn` needs of a robot."""

    tools: tuple[str, ...]
    grasp_gain: int  # how its software takes increments of the jaws
    contact: bool  # whether the force of what it touches is known


class CrtkConsole:
    """As `realtime.loop.Console`."""

    def __init__(
        self, end: LoopEnd, answers: Connection, ros: Ros, say: Callable[[str], None] = print
    ) -> None:
        """answers: where the process says why it ends. say: is told once that it has."""
        self._end, self._ros, self._say = end, ros, say
        self._answers: Connection | None = answers
        self._polls = 0

    def poll(self) -> list[dict[str, Any]]:
        """Commands of consoles of CRTK; none once the process that speaks it has ended."""
        self._polls += 1
        if self._polls % _LOOK_EVERY == 0 and self._answers is not None and self._answers.poll():
            try:
                why = self._answers.recv()
            except (EOFError, OSError):
                why = "the process that speaks it is gone"
            self._answers = None
            self._say(
                f"CRTK over {self._ros} has ended: {why}. Its pedal counts as up, nothing is told"
                " or heard there any more, and the robot goes on; CRTK comes back when ravenjax is"
                " started anew"
            )
        return self._end.poll()

    def tell(self, frame: Frame) -> None:
        """What the robot does."""
        self._end.tell(frame.row)


def spawn(
    stack: contextlib.ExitStack,
    ros: Ros,
    layout: FrameLayout,
    robot: RobotTraits,
    say: Callable[[str], None] = print,
) -> CrtkConsole:
    """Start the process and wait until it speaks; `say` is told where it ends. UserError where
    it cannot start.
    """
    end = LoopEnd(layout)
    stack.callback(end.close)
    answer, tells = multiprocessing.Pipe(duplex=False)
    stack.callback(answer.close)
    arms: tuple[ArmName, ...] = layout.arms
    options = bridge.BridgeOptions(end.rows.name, end.commands.name, ros, arms, *robot, tells)
    process = processes.spawn(stack, bridge.run, options)
    tells.close()
    if not answer.poll(processes.STARTING_S):
        raise UserError(f"CRTK over {ros} did not start within {processes.STARTING_S:g} s")
    try:
        trouble = answer.recv()
    except EOFError:
        process.join(processes.STARTING_S)
        raise UserError(
            f"the process that speaks CRTK ended with code {process.exitcode}; see above"
        ) from None
    if trouble:
        raise UserError(trouble)
    return CrtkConsole(end, answer, ros, say)


def traits(blueprint: Blueprint, elsewhere: bool = False) -> RobotTraits:
    """Those of a robot. elsewhere: it is not this one that is driven, and nobody tells what it
    touches.
    """
    gain = int(blueprint.plan.program.params.control.teleoperation.grasp_gain)
    return RobotTraits(blueprint.setup.tools, gain, blueprint.setup.contact and not elsewhere)
