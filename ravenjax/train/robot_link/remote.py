"""A robot elsewhere, as a session holds it: its packets out by ITP, its joints in over TCP. It
never waits.

The other end is `ravenjax robot`, or a real Raven with a program beside it that sends
`joints.record.RECORD`s; without such a one (`joint_port=None`) a Raven can be driven all the same,
but nothing is known of it.
"""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.packet import UDP_PORT
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot_link.joints.decoder import Decoder
from ravenjax.train.robot_link.joints.record import JointReport
from ravenjax.train.robot_link.joints.stream import JOINT_PORT

PATIENCE_S = 10.0
"""Longest that a robot may take to let a session in: a busy machine may leave it alone for
seconds.
"""
READ_BYTES = 1 << 16


class RemoteRobot:
    """The connection to one robot."""

    def __init__(
        self,
        host: str,
        itp_port: int = UDP_PORT,
        joint_port: int | None = JOINT_PORT,
        arms: Sequence[ArmName] = (),
        token: str | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """arms: those that the session needs. token: for orders to a robot on another machine.

        UserError where nobody is there, or the robot lacks an arm.
        """
        self._clock, self._token = clock, token
        self._decoder = Decoder()
        self._answers: list[dict[str, Any]] = []
        self._orders = bytearray()
        self._resets = 0  # that were not answered yet
        self._arrived_ms = float("-inf")
        self.report: JointReport | None = None  # the newest
        self.reports = 0  # that came
        self.unsent = 0  # packets that the system did not take
        self.lost = False  # the robot has ended the connection
        self.greeting: dict[
            str, Any
        ] = {}  # the robot's first words: its arms, scenario, seed and hazards
        self._stream: socket.socket | None = None
        self._console = connected_console(host, itp_port)
        if joint_port is not None:
            try:
                self._stream = _connected(host, joint_port)
                self.greeting = self._greeted(host, joint_port)
                self._require(arms, host, joint_port)
            except BaseException:
                self.close()
                raise

    def exchange(self, datagram: bytes) -> JointReport | None:
        """Send this tick's ITP packet (124 bytes) and return the newest report; None before the
        first.

        The report may be old: see `stale`.
        """
        try:
            self._console.send(datagram)
        except (
            OSError
        ):  # no room, or nobody listens there: the robot will miss this packet, as any that is lost
            self.unsent += 1
        self._read()
        self._write_orders()
        return self.report

    def order(self, content: dict[str, Any]) -> None:
        """Send an order of `joints.stream` to the robot's process, now or as soon as there is room.

        After a reset there is no report until one comes from the robot that was reset.
        """
        if content.get("order") == "reset" and self._stream is not None:
            self._resets += 1
            self.report = None
        request = content if self._token is None else content | {"token": self._token}
        self._orders += json.dumps(request, separators=(",", ":")).encode() + b"\n"
        self._write_orders()

    def answers(self) -> list[dict[str, Any]]:
        """What the robot answered to orders since the last call: {"answer": order, "ok": ...,
        "error": ...}.
        """
        answers, self._answers = self._answers, []
        return answers

    @property
    def age_ms(self) -> float:
        """Since a report last came; infinite before the first."""
        return self._clock() * 1e-6 - self._arrived_ms

    @property
    def stale(self) -> bool:
        """Whether nothing has come for `STALE_MS`: what is shown of the robot is then old."""
        return self.lost or self.age_ms > STALE_MS

    def close(self) -> None:
        """Leave the robot alone."""
        self._console.close()
        if self._stream is not None:
            self._stream.close()

    def _read(self) -> None:
        if self._stream is None or self.lost:
            return
        try:
            content = self._stream.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            content = b""
        self.lost = not content
        for record in self._decoder.feed(content):
            if not isinstance(record, JointReport):
                self._answers.append(record)
                self._resets -= record.get("answer") == "reset"
            elif not self._resets:
                self.report, self._arrived_ms = record, self._clock() * 1e-6
                self.reports += 1

    def _write_orders(self) -> None:
        if self._orders and self._stream is not None and not self.lost:
            try:
                del self._orders[: self._stream.send(self._orders)]
            except BlockingIOError:
                pass
            except OSError:
                self.lost = True

    def _greeted(self, host: str, port: int) -> dict[str, Any]:
        """Wait for the robot's first words."""
        deadline = time.monotonic() + PATIENCE_S
        while not self._answers and not self.lost and time.monotonic() < deadline:
            self._read()
            time.sleep(0.005)
        answers = self.answers()
        for answer in answers:
            if answer.get("robot") == "ravenjax":
                return answer
        heard = (
            "sent something else"
            if answers
            else "hung up"
            if self.lost
            else f"was silent for {PATIENCE_S:g} s"
        )
        raise UserError(
            f"{host}:{port} takes connections but is no ravenjax robot, or a busy one (it {heard}):"
            " start one there with `ravenjax robot`"
        )

    def _require(self, arms: Sequence[ArmName], host: str, port: int) -> None:
        there = self.greeting.get("arms", [])
        missing = [arm for arm in arms if arm not in there]
        if missing:
            raise UserError(
                f"the robot at {host}:{port} has arms {there}, but the session needs"
                f" {', '.join(missing)}: start both with the same scenario"
            )


def connected_console(host: str, port: int) -> socket.socket:
    """A socket for ITP packets to a robot. UserError where it has no address."""
    endpoint = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        endpoint.connect((host, port))
    except (OSError, OverflowError) as error:
        endpoint.close()
        raise UserError(
            f"no robot can be reached at {host}:{port} ({error}); expected a name or address"
        ) from None
    endpoint.setblocking(False)
    return endpoint


def _connected(host: str, port: int) -> socket.socket:
    try:
        endpoint = socket.create_connection((host, port), PATIENCE_S)
    except (OSError, OverflowError) as error:
        raise UserError(
            f"no robot answers at {host}:{port} ({error}): start one there with `ravenjax robot`,"
            " and give the port of its joint stream"
        ) from None
    endpoint.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    endpoint.setblocking(False)
    return endpoint
