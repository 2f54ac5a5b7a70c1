"""Connects a realtime loop to consoles that use CRTK, the ROS interface of surgical robots.

`CrtkConsole` belongs to the loop; a second process exchanges the ROS messages. Two rings in shared
memory connect them, so that neither waits for the other. The process writes commands into one ring.
The loop writes one row per tick into the other: the tick's `Frame`, wall-clock and monotonic time,
and the number of the last command that the loop has read.
"""

import contextlib
import signal
import sys
import time
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from ravenjax.errors import UserError
from ravenjax.store.ring import COMMAND_BYTES, Ring, parent_has_ended, put_json, read_json
from ravenjax.train import processes
from ravenjax.train.protocol import Command, Frame, FrameLayout, Say
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.crtk.interpreter import Interpreter, RobotRow
from ravenjax.train.session.simulation import Blueprint

PERIOD_S = 0.002  # Time between two readings of the rings and of the network
READINGS_HZ = 100.0  # Rate of the published measurements; the default of the dVRK's consoles
_KEPT_ROWS, _KEPT_COMMANDS, _COMMANDS_PER_TICK = 64, 1024, 16
_POLLS_PER_CHECK = 256
"""Calls of `poll` between two checks that the process runs. Each check is a system call."""


def _row_type(layout: FrameLayout) -> np.dtype:
    # Type of a row of the ring: a frame and the clocks at its tick, as in `RobotRow`.
    clocks = [(name, "<i8") for name in ("stamp_ns", "clock_ns", "last_command")]
    return np.dtype([("frame", "<f4", layout.size), *clocks])


def connect_transport(ros: messages.Ros, published: list[str], subscribed: list[str]) -> Any:
    """Return a `DdsTransport` or a `Ros1Transport`. Raises UserError if it is not available."""
    if ros == "ros2":
        try:
            from ravenjax.train.robot_link.crtk.dds import DdsTransport
        except ImportError as error:
            raise UserError(
                f"ROS 2 needs the package cyclonedds ({error}): install it with `pip install"
                " 'ravenjax[ros2]'`"
            ) from None
        return DdsTransport(published, subscribed)
    from ravenjax.train.robot_link.crtk.ros1 import Ros1Transport

    return Ros1Transport(published, subscribed)


class CrtkConsole:
    """A console of the realtime loop. It creates both rings."""

    _polls = 0
    taken = 0  # number of the last command returned
    process_connection: Connection | None = None  # delivers the reason when the process ends

    def __init__(self, layout: FrameLayout, ros: messages.Ros, say: Say = print):
        """say: prints why the process has ended."""
        self._row = np.zeros(1, _row_type(layout))
        self.rows = Ring.create(_KEPT_ROWS, self._row.nbytes)
        self.commands = Ring.create(_KEPT_COMMANDS, COMMAND_BYTES)
        self._ros, self._say = ros, say

    def poll(self) -> list[Command]:
        """Return the commands of CRTK's consoles; none once the CRTK process has ended."""
        self._polls += 1
        is_check_due = self._polls % _POLLS_PER_CHECK == 0
        if is_check_due and self.process_connection and self.process_connection.poll():
            try:
                reason = self.process_connection.recv()
            except (EOFError, OSError):
                reason = "its process was terminated"
            self.process_connection = None
            self._say(
                f"CRTK over {self._ros} has ended: {reason}. Its pedal counts as up, and the robot"
                " continues without CRTK. Restart ravenjax to use CRTK again"
            )
        if self.commands.written == self.taken:
            return []
        first, rows = self.commands.read(self.taken, _COMMANDS_PER_TICK)
        self.taken = first + len(rows)
        return list(read_json(rows))

    def send_frame(self, frame: Frame) -> None:
        self._row[0] = frame.row, time.time_ns(), time.monotonic_ns(), self.taken
        self.rows.put(self._row.view(np.uint8))

    def close(self) -> None:
        self.rows.close()
        self.commands.close()


def spawn_bridge(
    stack: contextlib.ExitStack, ros: messages.Ros, blueprint: Blueprint, say: Say, elsewhere: bool
) -> CrtkConsole:
    """Start the CRTK process for a blueprint's robot, and wait until it exchanges messages.
    elsewhere: another process has the robot, so contact is unknown. Raises UserError without ROS.
    """
    console = CrtkConsole(blueprint.layout, ros, say)
    stack.callback(console.close)
    setup, params = blueprint.setup, blueprint.plan.program.params
    rings, arms = (console.rows.name, console.commands.name), blueprint.layout.arms
    gain = int(params.control.teleoperation.grasp_gain)
    contact = "contact" in setup.stages and not elsewhere
    helper = processes.Helper(stack, run_bridge)
    helper.send((rings, ros, arms, setup.tools, gain, contact))
    if error := helper.receive_answer():
        raise UserError(error)
    console.process_connection = helper.connection
    say(f"CRTK: {ros}, {', '.join(messages.ARM_NAMES[arm] for arm in arms)}")
    network = "the DDS domain" if ros == "ros2" else "the ROS master"
    say(
        f"CRTK listens on every network of this machine, whatever --host says: whoever reaches"
        f" {network} can drive"
    )
    return console


def newest_row(rows: Ring, frame: Frame) -> RobotRow | None:
    """Return the last row of the ring, with its frame in `frame`; None before the first row."""
    first, newest = rows.read(rows.written - 1)
    if not len(newest):
        return None
    # A row of the ring is a frame, then the clocks.
    frame.row[:], *clocks = newest[-1].view(_row_type(frame.layout))[0]
    frame.copy_numbers()
    stamp_ns, clock_ns, last_command = map(int, clocks)
    return RobotRow(frame, stamp_ns, clock_ns, last_command, first + len(newest) - 1)


def run_bridge(robot: Connection) -> None:
    """Exchange CRTK messages until this process is terminated or the robot's process has ended.
    This is the entry point of a spawned process. robot: sends the arguments below, and receives
    None once the process is ready, later the reason why it ends.
    """
    # grasp_gain: mrad that the jaws close per mrad of an increment. contact: its force is known.
    names, ros, arms, tools, grasp_gain, contact = robot.recv()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the robot's process handles Ctrl-C
    # An orderly exit lets ROS learn that the topics are gone.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    try:
        topics = (messages.published_topics(arms, ros, contact), messages.command_topics(arms))
        transport = connect_transport(ros, *topics)
    except UserError as error:
        robot.send(str(error))
        return
    rows, commands = map(Ring.attach, names)
    frame = Frame(FrameLayout.of(arms))

    def report_refusal(reason: str):
        put_json(commands, {"type": "unheard", "console": "crtk", "once": True, "why": reason})

    interpreter = Interpreter(arms, tools, transport.types, grasp_gain, contact, report_refusal)
    robot.send(None)
    published_s = time.monotonic()
    try:
        while not parent_has_ended():
            start_s = time.monotonic()
            row, arrivals = newest_row(rows, frame), transport.poll()
            now_ms = time.monotonic() * 1e3
            if row is not None:
                connected, was_down = transport.connected(), interpreter.state.pedal
                interpreter.observe(row, connected, now_ms)
                for name, message in arrivals:
                    interpreter.receive(name, message, now_ms)
                # Without a console, CRTK sends no commands, so that it does not count as a console.
                if connected or arrivals or was_down or interpreter.state.pedal:
                    for command in interpreter.commands(now_ms):
                        put_json(commands, command)
                        interpreter.record_sent(commands.written)
                outgoing = interpreter.states(time.time_ns())
                if start_s - published_s >= 1 / READINGS_HZ:
                    # A late reading does not delay the next, but missed readings are left out.
                    published_s = max(published_s + 1 / READINGS_HZ, start_s - 1 / READINGS_HZ)
                    outgoing += interpreter.readings(row)
                for name, message in outgoing:
                    transport.publish(name, message)
            time.sleep(max(0.0, PERIOD_S - (time.monotonic() - start_s)))
    except UserError as error:
        robot.send(str(error))
    finally:
        transport.close()
        rows.close()
        commands.close()
