"""One robot with its ports: what a console asks goes in once a millisecond, what the robot does
goes out.

What a console sends within one millisecond is added up, as the original's network thread does
before the control loop looks; the robot gets it as one packet, numbered anew so that its own rules
see a stream without gaps: the gate has applied them. Beside the console of ITP there may be one of
CRTK. Which one is heard, and whether its pedal counts, says `session.console_arbiter`; but here
nobody has the seat while its pedal is up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.robots.raven2.stages.teleoperation import NO_PACKET_SEQUENCE
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.realtime.loop import Console
from ravenjax.train.robot_link.increments import Increments, merge
from ravenjax.train.robot_link.itp import ItpServer
from ravenjax.train.robot_link.joint_report import encode_report
from ravenjax.train.robot_link.joint_server import JointServer
from ravenjax.train.session.console_arbiter import ConsoleArbiter
from ravenjax.train.session.pedal import NETWORK, PedalReasons
from ravenjax.train.session.simulation import PacketRobot
from ravenjax.vocabulary import checks

ITP, CRTK = "itp", "crtk"
"""Consoles that a robot may have."""
CHECKS_EVERY = 100
"""Ticks between two looks at what the robot's own checks did, at least."""


class Station:
    """One robot with its ports: `tick` once a millisecond, `obey` for what is asked of it."""

    def __init__(
        self,
        machine: PacketRobot,
        itp: ItpServer,
        joints: JointServer,
        hazards: int,
        estop_row: int,
        crtk: Console | None = None,
    ) -> None:
        """hazards: rows that may be armed, from 0. estop_row: the row of the E-stop button.
        crtk: a console beside.
        """
        self.machine, self.itp, self.joints, self.crtk = machine, itp, joints, crtk
        self.armed: int | None = None
        self.ticks = 0
        self._hazards, self._estop_row = hazards, estop_row
        self._number = 0  # of the robot's newest packet
        self._arbiter, self._pedals = ConsoleArbiter(), PedalReasons()
        self._checks: dict[str, tuple[int, int]] = {}  # as the joint reports have them
        self._trips, self._looked = 0.0, 0  # of the checks at the last look, and its tick
        self._last_seq = NO_PACKET_SEQUENCE  # of the console's packet that the robot took last

    def tick(self) -> Frame:
        """Orders, the console's increments, the robot's millisecond, and what it reports."""
        for order in self.joints.poll():
            try:
                self.obey(order.content)
            except UserError as error:
                self.joints.answer(order, str(error))
            else:
                self.joints.answer(order)
        console, increments = self._choose()
        packet = None
        if increments is not None:
            self._number += 1
            packet = increments.packet(self._number)
        frame = self.machine.tick(packet)
        took_it = frame.number("last_seq") == float(np.float32(self._number))
        if increments is not None and took_it and console == ITP:
            self._last_seq = increments.sequence
        self._look(frame)
        self.joints.publish(encode_report(frame, self.ticks, self._last_seq, self._checks))
        drives = self._arbiter.owner != CRTK
        forces = {
            arm: frame[f"{arm}/force"].tolist() if drives else (0.0, 0.0, 0.0)
            for arm in self.machine.arms
        }
        runlevel, stopped = int(frame.number("runlevel")), bool(frame.number("soft_estopped"))
        self.itp.send_force(forces, runlevel, stopped, drives, drives)
        if self.crtk is not None:
            self.crtk.tell(frame)
        self.ticks += 1
        return frame

    def news(self) -> list[str]:
        """What a user should be told since the last call: of the console's packets, and of its
        pedal.
        """
        return [*self.itp.gate.news(), *self._pedals.news()]

    def _choose(self) -> tuple[str, Increments | None]:
        """Which console is heard in this tick, and what it asks for."""
        requests = {ITP: self.itp.receive()}
        if self.crtk is not None:
            requests[CRTK] = self._poll_crtk(self.crtk)
        chosen: tuple[str, Increments | None] = ITP, None
        if self._arbiter.vacate(self.ticks) == CRTK:
            # Its process is gone: nobody holds the pedal.
            chosen = CRTK, Increments.still(len(self.machine.arms))
        for console, request in requests.items():
            if request is None:
                continue

            def take(counted: Mapping[str, Any], request: Increments = request) -> bool:
                nonlocal chosen
                if chosen[1] is None or counted["pedal"]:
                    chosen = counted["console"], request._replace(pedal=int(counted["pedal"]))
                return True

            self._arbiter.hear({"console": console, "pedal": bool(request.pedal)}, take, self.ticks)
        self._arbiter.events()
        self._pedals.look({name: self._arbiter.why_not(name, self.ticks) for name in NETWORK})
        return chosen

    def _poll_crtk(self, console: Console) -> Increments | None:
        """What CRTK asks for: orders are obeyed at once."""
        requests: list[Increments] = []
        for command in console.poll():
            if command["type"] == "unheard":
                self._pedals.once(CRTK, command["why"])
            elif command["type"] == "operator":
                self.obey({"order": {"estop": "estop", "restart": "reset"}[command["do"]]})
            else:
                requests.append(Increments.of(command, self.machine.arms))
        return merge(requests)

    def _look(self, frame: Frame) -> None:
        """How often each check of the robot has tripped so far, and when it first did."""
        trips = frame.number("trips")
        if trips == self._trips or self.ticks - self._looked < CHECKS_EVERY:
            return
        self._trips, self._looked = trips, self.ticks
        outcomes, began = self.machine.outcomes(), self.ticks - int(frame.number("tick"))
        self._checks = {
            name: (count, began + int(outcomes[f"check_{name}_first_ms"]))
            for name in checks.names(outcomes)
            if (count := int(outcomes[f"check_{name}_count"])) > 0
        }

    def obey(self, content: dict[str, Any]) -> None:
        """Carry out an order of `joint_server`. UserError where it cannot be."""
        kind, number = content.get("order"), content.get("number")
        if kind == "arm":
            if type(number) is not int or not 0 <= number < self._hazards:
                expected = f"a hazard's number 0..{self._hazards - 1}"
                if not self._hazards:
                    expected = "no hazard: the scenario has none"
                raise UserError(f"number is {shown(number)}, expected {expected}")
            self.machine.arm(number)
            self.armed = number
        elif kind == "disarm":
            self.machine.disarm()
            self.armed = None
        elif kind == "estop":
            self.machine.press(self._estop_row)
            self._arbiter.rearm("", self.ticks)
        elif kind == "reset":
            self.machine.reset()
            self.armed, self._number = None, 0
            self._arbiter.rearm("restart", self.ticks)
            self._trips, self._checks = 0.0, {}
        else:
            raise UserError(f"order is {shown(kind)}, expected one of arm, disarm, estop, reset")
