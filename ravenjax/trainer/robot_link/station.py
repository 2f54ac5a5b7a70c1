"""One robot with its ports: what a console asks goes in once a millisecond, what the robot does goes out.

What a console sends within one millisecond is added up, as the original's network thread does before the control loop
looks; the robot gets it as one packet, numbered anew so that its own rules see a stream without gaps: the gate has
applied them.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.stages.teleoperation import NO_PACKET_SEQUENCE
from ravenjax.trainer.protocol.frame import Frame, FrameLayout
from ravenjax.trainer.robot_link.itp import ItpServer
from ravenjax.trainer.robot_link.joints.record import Reporter
from ravenjax.trainer.robot_link.joints.stream import JointServer, ListenerOrder


class DrivenRobot(Protocol):
    """What is driven; as `simulation.PacketRobot`."""

    arms: tuple[ArmName, ...]

    def tick(self, packet: Packet | None) -> Frame: ...
    def arm(self, row: int) -> None: ...
    def disarm(self) -> None: ...
    def press(self, row: int) -> None: ...
    def reset(self) -> None: ...


class Station:
    """One machine with its ports: `tick` once a millisecond, `obey` for what is asked of it."""

    def __init__(self, machine: DrivenRobot, itp: ItpServer, joints: JointServer, hazards: int, estop_row: int) -> None:
        """hazards: rows that may be armed, from 0. estop_row: the row of the E-stop button."""
        self.machine, self.itp, self.joints = machine, itp, joints
        self.armed: int | None = None
        self.ticks = 0
        self._hazards, self._estop_row = hazards, estop_row
        self._reporter = Reporter(FrameLayout.of(machine.arms))
        self._number = 0  # of the robot's newest packet
        self._last_seq = NO_PACKET_SEQUENCE  # of the console's packet that the robot took last

    def tick(self) -> Frame:
        """Orders, the console's increments, the robot's millisecond, and what it reports."""
        for order in self.joints.poll():
            self._answer(order)
        increments = self.itp.receive()
        packet = None
        if increments is not None:
            self._number += 1
            packet = increments.packet(self._number)
        frame = self.machine.tick(packet)
        if increments is not None and frame.number("last_seq") == float(np.float32(self._number)):
            self._last_seq = increments.sequence
        self.joints.publish(self._reporter.encode(frame, self.ticks, self._last_seq))
        forces = {arm: frame[f"{arm}/force"].tolist() for arm in self.machine.arms}
        self.itp.send_force(forces, int(frame.number("runlevel")), bool(frame.number("soft_estopped")))
        self.ticks += 1
        return frame

    def obey(self, content: dict[str, Any]) -> None:
        """Carry out an order of `joints.stream`. UserError where it cannot be."""
        kind = content.get("order")
        if kind == "arm":
            self._arm(content.get("number"))
        elif kind == "disarm":
            self.machine.disarm()
            self.armed = None
        elif kind == "estop":
            self.machine.press(self._estop_row)
        elif kind == "reset":
            self.machine.reset()
            self.armed, self._number = None, 0
        else:
            raise UserError(f"order is {shown(kind)}, expected one of arm, disarm, estop, reset")

    def _arm(self, number: Any) -> None:
        if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < self._hazards:
            expected = (
                f"a hazard's number 0..{self._hazards - 1}" if self._hazards else "no hazard: the scenario has none"
            )
            raise UserError(f"number is {shown(number)}, expected {expected}")
        self.machine.arm(number)
        self.armed = number

    def _answer(self, order: ListenerOrder) -> None:
        try:
            self.obey(order.content)
        except UserError as error:
            self.joints.answer(order, str(error))
        else:
            self.joints.answer(order)
