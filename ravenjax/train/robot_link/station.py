"""One robot with its ports: what a console asks goes in once a millisecond, what the robot does
goes out.

What a console sends within one millisecond is added up, as the original's network thread does
before the control loop looks; the robot gets it as one packet, numbered anew so that its own rules
see a stream without gaps: the gate has applied them. The pedal of a console that was silent for
`STALE_MS`, or that held it down while the robot was stopped or set back, counts as up until it was
seen up. Beside the console of ITP there may be one of CRTK: while the pedal of the one is down
nobody hears the other, and a pedal that was pressed meanwhile counts as up until it was seen up,
too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.robots.raven2.stages.teleoperation import NO_PACKET_SEQUENCE
from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.realtime.loop import Console
from ravenjax.train.robot_link.increments import Increments, merge
from ravenjax.train.robot_link.itp import ItpServer
from ravenjax.train.robot_link.joint_record import Reporter, encode_text
from ravenjax.train.robot_link.joint_server import JointServer
from ravenjax.train.session import pedal
from ravenjax.train.session.simulation import PacketRobot
from ravenjax.vocabulary import checks

ITP, CRTK = "itp", "crtk"
"""Consoles that a robot may have."""
CHECKS_EVERY = 100
"""Ticks between two reports of what the robot's own checks did, at least."""


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
        self._reporter = Reporter(FrameLayout.of(machine.arms))
        self._number = 0  # of the robot's newest packet
        self._lifted: set[str] = set()  # consoles whose pedal was seen up since it had to be
        self._advised: set[str] = set()  # consoles whose user was told to lift it
        self._heard: dict[str, int] = {}  # tick of each console's last packet
        self._driver: str | None = None  # whose pedal is down
        self._news: list[str] = []
        self._trips, self._reported = 0.0, 0  # of the checks at their last report, and its tick
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
        self.joints.publish(self._reporter.encode(frame, self.ticks, self._last_seq))
        self._report_checks(frame)
        drives = self._driver != CRTK
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
        news, self._news = self._news, []
        return [*self.itp.gate.news(), *news]

    def _choose(self) -> tuple[str, Increments | None]:
        """Which console is heard in this tick, and what it asks for: whose pedal is down keeps
        the other one out.
        """
        requests = {ITP: self.itp.receive()}
        if self.crtk is not None:
            requests[CRTK] = self._poll_crtk(self.crtk)
        counted = {
            name: self._with_counted_pedal(name, one)
            for name, one in requests.items()
            if one is not None
        }
        driver = self._driver
        if driver is not None and self.ticks - self._heard[driver] > STALE_MS:
            self._driver = None
            if driver == CRTK:  # its process is gone: nobody holds the pedal
                arms = len(self.machine.arms)
                level = ((0.0, 0.0, 0.0, 1.0),) * arms
                return CRTK, Increments(0, 0, ((0, 0, 0),) * arms, level, (0,) * arms)
        elif driver is None:
            self._driver = next((name for name, one in counted.items() if one.pedal), None)
        name = self._driver or next(iter(counted), ITP)
        for other, one in counted.items():
            if other != name and one.pedal:
                if other in self._lifted:
                    self._news.append(f"{other}: {pedal.rival(name)}")
                self._lifted.discard(other)
        request = counted.get(name)
        if request is not None and not request.pedal:
            self._driver = None
        return name, request

    def _poll_crtk(self, console: Console) -> Increments | None:
        """What CRTK asks for: orders are obeyed at once."""
        requests: list[Increments] = []
        for command in console.poll():
            if command["type"] == "unheard":
                self._news.append(f"{CRTK}: {command['why']}")
            elif command["type"] == "operator":
                self.obey({"order": {"estop": "estop", "restart": "reset"}[command["do"]]})
            else:
                requests.append(Increments.of(command, self.machine.arms))
        return merge(requests)

    def _with_counted_pedal(self, console: str, increments: Increments) -> Increments:
        """As they count: without a pedal that was down all the time."""
        if self.ticks - self._heard.get(console, 0) > STALE_MS:
            self._lifted.discard(console)
        self._heard[console] = self.ticks
        if not increments.pedal:
            self._lifted.add(console)
            self._advised.discard(console)
        elif console not in self._lifted and console not in self._advised:
            self._advised.add(console)
            self._news.append(f"{console}: {pedal.LIFT}")
        return increments if console in self._lifted else increments._replace(pedal=0)

    def _report_checks(self, frame: Frame) -> None:
        """How often each check of the robot has tripped so far, and how long ago it first did."""
        trips = frame.number("trips")
        if trips == self._trips or self.ticks - self._reported < CHECKS_EVERY:
            return
        self._trips, self._reported = trips, self.ticks
        outcomes, now = self.machine.outcomes(), int(frame.number("tick"))
        report = {
            name: [count, now - int(outcomes[f"check_{name}_first_ms"])]
            for name in checks.names(outcomes)
            if (count := int(outcomes[f"check_{name}_count"])) > 0
        }
        self.joints.publish(encode_text({"checks": report}))

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
            self._lifted.clear()
        elif kind == "reset":
            self.machine.reset()
            self.armed, self._number = None, 0
            self._lifted.clear()
            self._trips = 0.0
        else:
            raise UserError(f"order is {shown(kind)}, expected one of arm, disarm, estop, reset")
