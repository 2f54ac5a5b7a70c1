"""A robot elsewhere that tells of itself over ROS and is driven over ITP, as a real Raven is.

Over ROS 1 it is raven2's `ravenstate` that is heard, in whichever version its publisher has it,
over ROS 2 CRTK's `measured_js`, `setpoint_js` and `operating_state` of each arm. What a session
asks beside motion is `state_command`: an E-stop is `disable`, a restart is `home`. Hazards cannot
be armed there.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.errors import UserError
from ravenjax.numbers.lazy import at_once
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.run_levels import E_STOP, INIT, PEDAL_DOWN, PEDAL_UP
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot_link.crtk import messages, names
from ravenjax.train.robot_link.crtk.bridge import Transport
from ravenjax.train.robot_link.crtk.messages import Ros
from ravenjax.train.robot_link.crtk.names import ARM_NAMES, RosTopic
from ravenjax.train.robot_link.joints.record import ARM_SHIFT, RECORD, JointReport
from ravenjax.train.robot_link.remote import connected_console

_RADIANS = np.pi / 180
_PLACES = np.array([0, 1, 2, 4, 5, 6, 7])  # of an arm's 8 in ravenstate; number 3 is not connected
_ORDERS = {"estop": "disable", "reset": "home"}


class RosRobot:
    """As `remote.RemoteRobot`, for `distant.DistantRobot`."""

    def __init__(
        self,
        host: str,
        itp_port: int,
        arms: Sequence[ArmName],
        tools: Sequence[str],
        transport: Transport,
        clock: Callable[[], int] = time.monotonic_ns,
        say: Callable[[str], None] = print,
    ) -> None:
        """tools: one an arm. say: is told where ROS is lost. UserError where the host has no
        address.
        """
        self._arms, self._transport, self._clock = tuple(arms), transport, clock
        self._say = say
        self._console: socket.socket = connected_console(host, itp_port)
        self._record = np.zeros(1, RECORD)
        self._record["flags"] = sum(1 << ARM_SHIFT + ARMS.index(arm) for arm in arms)
        self._motors = {arm: _rates(arm, tool) for arm, tool in zip(arms, tools, strict=True)}
        self._missing = {topic.name for topic in self.topics(arms, transport.types.ros)[1]}
        self._levels: dict[ArmName, int] = {}
        self._began_ns = 0
        self._arrived_ms = float("-inf")
        self.report: JointReport | None = None
        self.reports = self.unsent = 0
        self.lost = False  # nothing can be heard of it any more

    @staticmethod
    def topics(arms: Sequence[ArmName], ros: Ros) -> tuple[list[RosTopic], list[RosTopic]]:
        """What such a robot is told, and what is heard of it."""
        return [RosTopic("state_command", messages.STRING)], names.reported(
            arms, raven_state=ros == "ros1"
        )

    def exchange(self, datagram: bytes) -> JointReport | None:
        """Send this tick's ITP packet (124 bytes) and return the newest report; None before the
        first.
        """
        try:
            self._console.send(datagram)
        except OSError:
            self.unsent += 1
        for name, message in self._heard():
            if name == "ravenstate":
                self._take_raven_state(message)
            else:
                self._take(name, message)
        return self.report

    def order(self, content: dict[str, Any]) -> None:
        """What CRTK has a command for; anything else is nothing."""
        word = _ORDERS.get(str(content.get("order")))
        if word is not None and not self.lost:
            types = self._transport.types
            self._transport.publish(
                "state_command", types.string(types.header(time.time_ns(), ""), word)
            )

    def answers(self) -> list[dict[str, Any]]:
        """None ever come."""
        return []

    @property
    def stale(self) -> bool:
        """Whether nothing has come for `STALE_MS`."""
        return self.lost or self._clock() * 1e-6 - self._arrived_ms > STALE_MS

    def close(self) -> None:
        """Leave the robot alone."""
        self._console.close()

    def _heard(self) -> list[tuple[str, Any]]:
        """What has come; nothing more, and the robot counts as stopped, once ROS is lost."""
        if self.lost:
            return []
        try:
            return self._transport.poll()
        except UserError as error:
            self.lost = True
            self._say(
                f"nothing is heard of the robot any more: {error}; it counts as stopped. Start the"
                " session anew"
            )
            return []

    def _take_raven_state(self, message: Any) -> None:
        stamp = message.hdr.stamp
        record = self._record[0]
        for arm in self._arms:
            slot, there = ARMS.index(arm), record["arms"][ARMS.index(arm)]
            at = 8 * slot + _PLACES
            for name in ("jpos", "jpos_d", "mpos", "mvel"):
                there[name] = np.asarray(getattr(message, name))[at] * _RADIANS
            there["position_um"] = np.asarray(message.pos)[3 * slot : 3 * slot + 3]
            counts = getattr(message, "dac_val", None)
            if counts is None:
                counts = getattr(message, "current_cmd", np.zeros(16))
            there["dac"] = np.asarray(counts)[at]
        self._publish(
            int(stamp.sec) * 10**9 + int(stamp.nanosec),
            int(message.runlevel),
            int(message.last_seq),
        )

    def _take(self, name: str, message: Any) -> None:
        alias, _, word = name.partition("/")
        arm: ArmName = next(one for one in self._arms if ARM_NAMES[one] == alias)
        there = self._record[0]["arms"][ARMS.index(arm)]
        if word == "operating_state":
            self._levels[arm] = _runlevel(message)
        else:
            jpos = messages.numbers_of(message.position, 7)
            if jpos is None:
                return
            if word == "setpoint_js":
                there["jpos_d"] = jpos
            else:
                there["jpos"] = jpos
                motors = self._motors[arm]
                there["mpos"] = motors @ np.array(jpos)
                there["mvel"] = motors @ np.array(
                    messages.numbers_of(message.velocity, 7) or (0.0,) * 7
                )
                with at_once():
                    tip = kinematics.forward(arm, Vec(jpos)).position
                there["position_um"] = np.rint(np.array(tip, float) * 1e6)
        was_missing = name in self._missing
        self._missing.discard(name)
        if not self._missing and (was_missing or (word == "measured_js" and arm == self._arms[-1])):
            self._publish(messages.stamp_ns(message), min(self._levels.values()), 0)

    def _publish(self, stamp_ns: int, runlevel: int, last_seq: int) -> None:
        """The record is whole."""
        self._began_ns = self._began_ns or stamp_ns
        record = self._record[0]
        record["tick"] = max(stamp_ns - self._began_ns, 0) // 10**6 % 2**32
        record["runlevel"], record["surgeon_mode"] = runlevel & 3, runlevel == PEDAL_DOWN
        record["last_seq"] = last_seq % 2**32
        self.report = JointReport(self._record.copy()[0])
        self.reports += 1
        self._arrived_ms = self._clock() * 1e-6


def _runlevel(message: Any) -> int:
    """What the software of a Raven is in that is in this operating state."""
    if message.state == "ENABLED":
        return INIT if message.is_busy and not message.is_homed else PEDAL_DOWN
    return PEDAL_UP if message.is_homed else E_STOP


def _rates(arm: ArmName, tool: str) -> np.ndarray:
    """Motor rates of joint rates, [7, 7]: the cables couple them."""
    with at_once():
        columns = [transmission.motor_from_joint(arm, tool, Vec(row)) for row in np.eye(7).tolist()]
    return np.array(columns, float).T
