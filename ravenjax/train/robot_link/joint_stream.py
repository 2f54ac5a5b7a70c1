"""Sends the robot's joint state over TCP to several listeners, and receives their orders.

`JointServer` runs in the robot's process. `RemoteRobot` connects a session to `ravenjax robot`, or
to a program that sends these reports from a real Raven. No process waits for another. Every line is
a JSON object (docs/how-to/training-messages.md). The server disconnects a client that sends
anything else, such as a web page that probes local ports.
"""

import collections
import contextlib
import json
import socket
import time
from collections.abc import Iterator

from pydantic import BaseModel, field_validator
from pydantic_core import to_json

from ravenjax.errors import UserError
from ravenjax.train.page import is_loopback, same_secret
from ravenjax.train.protocol import STALE_MS, Frame, Json
from ravenjax.train.robot import Arms
from ravenjax.train.robot_link import WORDS, refuse_errors

JOINT_PORT = 36002
"""Default port. The console uses UDP port 36000, raven2's packet generator 36001."""
BUFFER_BYTES = 1 << 17
"""Size of a listener's buffer here and in the kernel, bytes: a tenth of a second each."""
READ_BYTES = 1 << 16
MAX_ORDER_BYTES = 1024  # bytes
_NOT_ALLOWED = "not from the robot's machine: start robot and session with the same --token"
_ROBOT_SIZES, ARM_SIZES = WORDS["report"], WORDS["report_arm"]
_SIZES = _ROBOT_SIZES | ARM_SIZES
PATIENCE_S = 10.0


TrippedChecks = dict[str, tuple[int, int]]
"""Number of trips of each check that has tripped, and tick of its first trip."""


class JointReport(BaseModel):
    """A robot's report on one tick."""

    tick: int
    last_seq: int
    checks: TrippedChecks = {}
    channels: dict[str, list[float]]

    @field_validator("channels")
    @classmethod
    def _require_sizes(cls, channels: dict[str, list[float]]) -> dict[str, list[float]]:
        # Refuses channels of another size, and a run level that is missing or unknown.
        for name, numbers in channels.items():
            size = _SIZES.get(name.rpartition("/")[2])
            if len(numbers) != size:
                raise ValueError(f"channel {name} has {len(numbers)} numbers, expected {size}")
        if channels.get("runlevel", [-1])[0] not in range(4):
            raise ValueError("runlevel is missing or not 0 to 3")
        return channels

    @property
    def runlevel(self) -> int:
        return int(self.channels["runlevel"][0])

    def fill(self, frame: Frame) -> None:
        """Write the report into `frame`. Arms that the frame lacks are ignored. A report lacks the
        true links and tip, so their channels get the measured values.
        """
        frame["tick"], frame["last_seq"] = self.tick, self.last_seq
        true_channels = {"jpos": "link_jpos", "position": "tip"}
        for name, numbers in self.channels.items():
            arm, _, quantity = name.rpartition("/")
            if not arm or arm in frame.layout.arms:
                frame[name] = numbers
                if quantity in true_channels:
                    frame[f"{arm}/{true_channels[quantity]}"] = numbers


def encode_report(frame: Frame, tick: int, last_seq: int, checks: TrippedChecks) -> bytes:
    """Return a report as a line. The arguments are those of `JointReport`."""
    numbers, places = frame.row.tolist(), frame.layout.places
    names = (*_ROBOT_SIZES, *(f"{arm}/{name}" for arm in frame.layout.arms for name in ARM_SIZES))
    channels = {name: numbers[places[name]] for name in names}
    return encode_line({"tick": tick, "last_seq": last_seq, "checks": checks, "channels": channels})


def encode_line(content: Json) -> bytes:
    """Return an object as a JSON line."""
    return to_json(content) + b"\n"


class LineConnection:
    """Sends and receives lines over a TCP connection. Its methods never wait."""

    def __init__(self, connection: socket.socket, local: bool = True):
        """local: whether the other end is on this machine."""
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self.local, self.is_closed = local, False
        self._socket = connection
        self._outgoing, self._incoming = bytearray(), b""

    def send(self, line: bytes = b"") -> bool:
        """Buffer a line, and send what the kernel accepts. Returns False if the buffer is full."""
        fits = len(self._outgoing) + len(line) <= BUFFER_BYTES
        if fits:
            self._outgoing += line
        try:
            if self._outgoing and not self.is_closed:
                del self._outgoing[: self._socket.send(self._outgoing)]
        except BlockingIOError:
            pass
        except OSError:
            self.close()
        return fits

    def read(self, max_bytes: int = BUFFER_BYTES) -> list[bytes]:
        """Return the complete lines that have arrived. Raises ValueError if a line has more than
        `max_bytes`. The connection closes when the other end has closed it.
        """
        if self.is_closed:
            return []
        try:
            content = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return []
        # As at the end of the connection, no bytes arrive.
        except OSError:
            content = b""
        *lines, self._incoming = (self._incoming + content).split(b"\n")
        if not content:
            self.close()
        if max(map(len, (*lines, self._incoming))) > max_bytes:
            raise ValueError(f"a line has more than {max_bytes} bytes")
        return lines

    def close(self) -> None:
        self.is_closed = True
        self._socket.close()


ListenerOrder = tuple[LineConnection, Json]
"""A listener that may give orders, and the content of its order."""


class JointServer:
    """A TCP port for listeners. Call `poll` and `publish` once a tick; they never wait."""

    def __init__(self, greeting: Json, host: str, port: int, token: str | None = None):
        """greeting: first line to each listener. Raises UserError if the port cannot be opened."""
        self._greeting, self._token = encode_line(greeting), token
        with refuse_errors(
            f"TCP {host}:{port} cannot be opened for the joint stream",
            "another robot may use it. Give another port, or 0 for any free one",
        ):
            self._socket = socket.create_server((host, port))
        self._socket.setblocking(False)
        self.listeners: list[LineConnection] = []
        self.counts: collections.Counter[str] = collections.Counter()

    @property
    def address(self) -> tuple[str, int]:
        return self._socket.getsockname()[:2]

    def poll(self) -> list[ListenerOrder]:
        """Accept new listeners, and return the orders that have arrived."""
        # An error means that no listener waits, or that it has left.
        with contextlib.suppress(OSError):
            connection, address = self._socket.accept()
            listener = LineConnection(connection, is_loopback(address[0]))
            self.listeners.append(listener)
            self.counts["listeners"] += 1
            listener.send(self._greeting)
        orders = [order for listener in self.listeners for order in self._read_orders(listener)]
        self.listeners = [listener for listener in self.listeners if not listener.is_closed]
        return orders

    def publish(self, line: bytes) -> None:
        """Send a line to every listener. A listener without room for it loses the line."""
        for listener in self.listeners:
            sent = listener.send(line)
            self.counts["records" if sent else "records_dropped"] += 1

    def answer(self, order: ListenerOrder, error: str | None = None) -> None:
        """Send the result of an order to its listener: success if `error` is None, or the error."""
        listener, content = order
        kind = content.get("order")
        reply = {"answer": kind if isinstance(kind, str) else None, "ok": error is None}
        listener.send(encode_line(reply if error is None else reply | {"error": error}))

    def close(self) -> None:
        for listener in self.listeners:
            listener.close()
        self._socket.close()

    def _read_orders(self, listener: LineConnection) -> Iterator[ListenerOrder]:
        """Yield the orders of a listener, and refuse those without the token."""
        try:
            contents = [json.loads(line) for line in listener.read(MAX_ORDER_BYTES)]
            if not all(isinstance(content, dict) for content in contents):
                raise ValueError("an order is no JSON object")
        except (ValueError, RecursionError):
            self.counts["garbled"] += 1
            listener.close()
            return
        for content in contents:
            token = content.get("token")
            if listener.local or (isinstance(token, str) and same_secret(token, self._token)):
                self.counts["orders"] += 1
                yield listener, content
            else:
                self.counts["orders_refused"] += 1
                self.answer((listener, content), _NOT_ALLOWED)


class RobotLink:
    """The connection to one robot."""

    clock = staticmethod(time.monotonic_ns)

    report: JointReport | None = None  # the newest report
    lost = False  # whether the connection to the robot has ended
    _arrived_ms = float("-inf")

    def __init__(self, host: str, itp_port: int):
        """Raises UserError if the host has no address."""
        self._console = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with refuse_errors(
            f"no robot can be reached at {host}:{itp_port}",
            "give a host name or an address",
            self._console,
        ):
            self._console.connect((host, itp_port))
        self._console.setblocking(False)

    def exchange(self, datagram: bytes) -> JointReport | None:
        """Send this tick's ITP packet. Return the newest report, which may be `stale`."""
        # A packet that cannot be sent is treated as a packet that the network loses.
        with contextlib.suppress(OSError):
            self._console.send(datagram)
        if not self.lost:
            self._read_reports()
        return self.report

    def _read_reports(self):
        """Read the reports that have arrived."""

    def order(self, content: Json) -> None:
        """Send an order of `joint_stream` to the robot."""

    @property
    def stale(self) -> bool:
        """Whether no report has arrived for `STALE_MS`."""
        return self.lost or self.clock() * 1e-6 - self._arrived_ms > STALE_MS

    def close(self) -> None:
        self._console.close()

    def _store_report(self, report: JointReport):
        self.report, self._arrived_ms = report, self.clock() * 1e-6


class RemoteRobot(RobotLink):
    """A robot in another process that sends a joint stream."""

    _resets = 0  # number of orders "reset" without an answer so far

    def __init__(
        self, host: str, itp_port: int, joint_port: int, arms: Arms, token: str | None = None
    ):
        """arms: the arms that the session needs. token: for orders to a robot on another machine.
        Raises UserError if no robot answers, or if the robot lacks an arm.
        """
        super().__init__(host, itp_port)
        self._token = token
        self.greeting: Json = {}  # The robot's greeting: its arms, scenario, seed and hazards
        with refuse_errors(
            f"no robot answers at {host}:{joint_port}",
            "start one there with `ravenjax robot`, and give the port of its joint stream",
            self._console,
        ):
            connection = socket.create_connection((host, joint_port), PATIENCE_S)
        self._stream = LineConnection(connection)
        deadline = time.monotonic() + PATIENCE_S
        while not self.greeting and not self.lost and time.monotonic() < deadline:
            self._read_reports()
            time.sleep(0.005)
        robot_arms = self.greeting.get("arms", [])
        missing = [arm for arm in arms if arm not in robot_arms]
        if self.greeting and not missing:
            return
        self.close()
        if self.greeting:
            raise UserError(
                f"the robot at {host}:{joint_port} has arms {robot_arms}, but the session needs"
                f" {', '.join(missing)}: start both with the same scenario"
            )
        behaviour = "closed the connection" if self.lost else f"sent nothing for {PATIENCE_S:g} s"
        raise UserError(
            f"{host}:{joint_port} accepts connections but {behaviour}. It is busy or not a"
            " ravenjax robot: start one there with `ravenjax robot`"
        )

    def order(self, content: Json) -> None:
        """Send an order. After "reset", reports are ignored until the robot has restarted."""
        if content.get("order") == "reset":
            self._resets += 1
            self.report = None
        request = content if self._token is None else content | {"token": self._token}
        self._stream.send(encode_line(request))

    def close(self) -> None:
        super().close()
        self._stream.close()

    def _read_reports(self):
        try:
            for line in self._stream.read():
                self._process_line(line)
        # A line of another program than a robot.
        except ValueError:
            self.lost = True
        # Send the orders that still wait in the buffer.
        self._stream.send()
        self.lost = self.lost or self._stream.is_closed

    def _process_line(self, line: bytes):
        """Read a report, an answer or a greeting. Raises ValueError if a line is none of these.
        Reports are ignored while the answer to an order "reset" is awaited.
        """
        if line.startswith(b'{"tick"'):
            if not self._resets:
                self._store_report(JointReport.model_validate_json(line))
            return
        content = json.loads(line)
        if not isinstance(content, dict):
            raise ValueError("no JSON object")
        if content.get("answer") == "reset":
            self._resets -= 1
        if content.get("robot") == "ravenjax":
            self.greeting = content
