"""The process that speaks CRTK beside a robot's realtime loop."""

from __future__ import annotations

import dataclasses
import multiprocessing
import signal
import sys
import time
from multiprocessing.connection import Connection
from typing import Any, Protocol

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train.protocol.frame import FrameLayout
from ravenjax.train.robot_link.crtk import names
from ravenjax.train.robot_link.crtk.exchange import BridgeEnd
from ravenjax.train.robot_link.crtk.interpreter import Interpreter
from ravenjax.train.robot_link.crtk.messages import MessageTypes, Ros

PERIOD_S = 0.002
"""Between two looks at robot and network."""
HERTZ = 100.0
"""Of everything measured, as the consoles of the dVRK have it where nobody says otherwise."""
_PARENT_S = 1.0


class Transport(Protocol):
    """Topics of one ROS."""

    ros: Ros
    types: MessageTypes

    def publish(self, name: str, message: Any) -> None: ...
    def poll(self) -> list[tuple[str, Any]]: ...
    def connected(self) -> bool: ...
    def close(self) -> None: ...


@dataclasses.dataclass(frozen=True)
class BridgeOptions:
    """Picklable, so that a spawned process gets it whole."""

    rows: str  # names of the rings
    commands: str
    ros: Ros
    arms: tuple[ArmName, ...]
    tools: tuple[str, ...]
    grasp_gain: int
    contact: bool  # whether the force of what the robot touches is known
    tells: (
        Connection  # the process says here that it speaks (None), or why it does not, or no longer
    )
    hertz: float = HERTZ


def run(options: BridgeOptions) -> None:
    """Speak until the process is terminated or the robot's is gone. The entry point of a spawned
    process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the robot's to take
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # others are told that the topics are gone
    try:
        topics = names.published(options.arms, options.ros == "ros1", options.contact)
        transport = connect(options.ros, topics, names.subscribed(options.arms))
    except UserError as error:
        options.tells.send(str(error))
        return
    end = BridgeEnd(options.rows, options.commands, FrameLayout.of(options.arms))

    def refused(why: str) -> None:
        end.send({"type": "unheard", "console": "crtk", "once": True, "why": why})

    arms, tools, gain = options.arms, options.tools, options.grasp_gain
    interpreter = Interpreter(
        arms, tools, transport.types, gain, contact=options.contact, refused=refused
    )
    options.tells.send(None)
    try:
        _work(transport, end, interpreter, options.hertz)
    except UserError as error:
        options.tells.send(str(error))
    finally:
        transport.close()
        end.close()


def connect(
    ros: Ros, published: list[names.RosTopic], subscribed: list[names.RosTopic]
) -> Transport:
    """The transport of this ROS. UserError where it cannot be had."""
    if ros == "ros2":
        from ravenjax.train.robot_link.crtk.dds import DdsTransport

        return DdsTransport(published, subscribed)
    from ravenjax.train.robot_link.crtk.ros1 import Ros1Transport

    return Ros1Transport(published, subscribed)


def _work(transport: Transport, end: BridgeEnd, interpreter: Interpreter, hertz: float) -> None:
    parent = multiprocessing.parent_process()
    published = checked = time.monotonic()
    while True:
        began = time.monotonic()
        if began - checked > _PARENT_S:
            checked = began
            if parent is not None and not parent.is_alive():
                return
        row = end.newest()
        heard = transport.poll()
        now_ms = time.monotonic() * 1e3
        if row is not None:
            connected, was_down = transport.connected(), interpreter.state.pedal
            interpreter.observe(row, connected, now_ms)
            for name, message in heard:
                interpreter.hear(name, message, now_ms)
            if connected or heard or was_down or interpreter.state.pedal:
                for command in interpreter.commands(now_ms):
                    interpreter.note_sent(end.send(command))
            for name, message in interpreter.states(time.time_ns()):
                transport.publish(name, message)
            if began - published >= 1 / hertz:
                published = max(published + 1 / hertz, began - 1 / hertz)
                for name, message in interpreter.readings(row):
                    transport.publish(name, message)
        time.sleep(max(0.0, PERIOD_S - (time.monotonic() - began)))
