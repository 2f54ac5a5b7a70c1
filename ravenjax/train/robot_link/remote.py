"""Connects a session to a remote robot: sends ITP packets, receives reports, and never waits.

The other end of `RemoteRobot` is `ravenjax robot`, or a real Raven with a program that sends its
reports (`joint_stream`) over TCP.
"""

import abc
import contextlib
import json
import socket
import time
from collections.abc import Callable, Sequence

from ravenjax.errors import UserError
from ravenjax.train.protocol.messages import STALE_MS, Json
from ravenjax.train.robot import UDP_PORT, ArmName
from ravenjax.train.robot_link.joint_stream import (
    JOINT_PORT,
    JointReport,
    LineConnection,
    encode_line,
)

PATIENCE_S = 10.0
"""The longest time that a robot, perhaps a busy one, may take to accept a session."""


class RobotLink(abc.ABC):
    """The connection to one robot."""

    def __init__(
        self, host: str, itp_port: int, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Raises UserError if the host has no address."""
        self.report: JointReport | None = None  # the newest report
        self.lost = False  # whether the robot can no longer be heard
        self._clock, self._arrived_ms = clock, float("-inf")
        self._console = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._console.connect((host, itp_port))
        except (OSError, OverflowError) as error:
            self._console.close()
            raise UserError(
                f"no robot can be reached at {host}:{itp_port} ({error}): give a host name or an"
                " address"
            ) from None
        self._console.setblocking(False)

    def exchange(self, datagram: bytes) -> JointReport | None:
        """Send this tick's ITP packet. Return the newest report, which may be `stale`."""
        # If the packet cannot be sent, the robot misses it, like any packet that is lost.
        with contextlib.suppress(OSError):
            self._console.send(datagram)
        if not self.lost:
            self._read()
        return self.report

    @abc.abstractmethod
    def _read(self) -> None:
        """Take the reports that have arrived."""

    @abc.abstractmethod
    def order(self, content: Json) -> None:
        """Send an order of `joint_stream` to the robot."""

    @property
    def stale(self) -> bool:
        """Whether no report has arrived for `STALE_MS`, so that the robot's shown state is old."""
        return self.lost or self._clock() * 1e-6 - self._arrived_ms > STALE_MS

    def close(self) -> None:
        self._console.close()

    def _arrived(self, report: JointReport) -> None:
        self.report, self._arrived_ms = report, self._clock() * 1e-6


class RemoteRobot(RobotLink):
    """A robot with a joint stream."""

    def __init__(
        self,
        host: str,
        itp_port: int = UDP_PORT,
        joint_port: int = JOINT_PORT,
        arms: Sequence[ArmName] = (),
        token: str | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """arms: those that the session needs. token: for orders to a robot on another machine.

        Raises UserError if no robot answers, or the robot lacks an arm.
        """
        super().__init__(host, itp_port, clock)
        self._token = token
        self._resets = 0  # resets that were not answered yet
        self._stream: LineConnection | None = None
        try:
            try:
                self._stream = LineConnection(
                    socket.create_connection((host, joint_port), PATIENCE_S)
                )
            except (OSError, OverflowError) as error:
                raise UserError(
                    f"no robot answers at {host}:{joint_port} ({error}): start one there with"
                    " `ravenjax robot`, and give the port of its joint stream"
                ) from None
            # The robot's greeting: its arms, scenario, seed and hazards.
            self.greeting: Json = {}
            self._await_greeting(f"{host}:{joint_port}")
            there = self.greeting.get("arms", [])
            if missing := [arm for arm in arms if arm not in there]:
                raise UserError(
                    f"the robot at {host}:{joint_port} has arms {there}, but the session needs"
                    f" {', '.join(missing)}: start both with the same scenario"
                )
        except BaseException:
            self.close()
            raise

    def order(self, content: Json) -> None:
        """Send an order. After a reset there is no report until the robot has restarted."""
        if content.get("order") == "reset":
            self._resets += 1
            self.report = None
        request = content if self._token is None else content | {"token": self._token}
        if self._stream is not None:
            self._stream.send(encode_line(request))

    def close(self) -> None:
        super().close()
        if self._stream is not None:
            self._stream.close()

    def _read(self) -> None:
        assert self._stream is not None
        try:
            for line in self._stream.read():
                self._take(line)
        except ValueError:
            self.lost = True
        self._stream.send()
        self.lost = self.lost or self._stream.is_closed

    def _take(self, line: bytes) -> None:
        """Take a complete line. Raises ValueError if a robot would not send it."""
        if line.startswith(b'{"tick"'):
            if not self._resets:
                self._arrived(JointReport.model_validate_json(line))
            return
        content = json.loads(line)
        if not isinstance(content, dict):
            raise ValueError("no JSON object")
        self._resets -= content.get("answer") == "reset"
        if content.get("robot") == "ravenjax":
            self.greeting = content

    def _await_greeting(self, address: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not self.greeting and not self.lost and time.monotonic() < deadline:
            self._read()
            time.sleep(0.005)
        if not self.greeting:
            heard = "closed the connection" if self.lost else f"sent nothing for {PATIENCE_S:g} s"
            raise UserError(
                f"{address} accepts connections but {heard}. It is busy or not a ravenjax robot:"
                " start one there with `ravenjax robot`"
            )
