"""ROS 1 by the system's rospy: a node of its own, run by the Python that has it, beside this
process.

Only bytes pass between the two: `messages` makes and reads them here, so that the node needs no
message packages.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train.robot_link.crtk import messages, ros1_node
from ravenjax.train.robot_link.crtk.ros1_node import HEAD, TABLE

PYTHON = "RAVENJAX_ROS1_PYTHON"
"""Environment variable: the Python that has rospy, where it is not the system's."""
PATIENCE_S = 20.0
_ROOM = 1 << 16
"""Bytes that wait for the node; what does not fit is dropped whole."""
_READ = 1 << 16


class Ros1Transport:
    """Topics over ROS 1. `publish` and `poll` never wait."""

    def __init__(self, published: Sequence[str], subscribed: Sequence[str]) -> None:
        """UserError where rospy or its master is missing."""
        self.types = messages.types("ros1")
        self._published, self._subscribed = list(published), list(subscribed)
        self._connected = 0
        self._defined: dict[int, messages.MessageTypes] = {}  # as their publishers have them
        self._waiting, self._bytes = bytearray(), bytearray()
        self._node = subprocess.Popen(
            [_python(), str(Path(ros1_node.__file__))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=_environment(),
            start_new_session=True,  # Ctrl-C is this process's to take
        )
        assert self._node.stdin is not None and self._node.stdout is not None
        self._into, self._out = self._node.stdin.fileno(), self._node.stdout.fileno()
        os.set_blocking(self._out, False)
        table = {
            "name": "ravenjax",
            "published": [self._described(name) for name in published],
            # Versions of ravenstate differ: its publisher says how it is defined.
            "subscribed": [self._described(name, name == "ravenstate") for name in subscribed],
        }
        content = json.dumps(table).encode()
        try:
            # This write blocks until the node has taken all of it.
            os.write(self._into, HEAD.pack(TABLE, len(content)) + content)
            self._await_node()
        except BaseException:
            self.close()
            raise
        os.set_blocking(self._into, False)

    def publish(self, name: str, message: Any) -> None:
        """Send a message of `types` to whoever subscribes to the topic."""
        content = self.types.encode(message)
        if len(self._waiting) + len(content) <= _ROOM:
            self._waiting += HEAD.pack(self._published.index(name), len(content)) + content
            self._write()

    def poll(self) -> list[tuple[str, Any]]:
        """Topic and message of what has come. UserError where the node has ended."""
        self._write()
        arrivals: list[tuple[str, Any]] = []
        for number, content in self._arrived():
            if number == TABLE:
                self._hear_of_node(json.loads(content))
                continue
            name, types = self._subscribed[number], self._defined.get(number, self.types)
            with contextlib.suppress(ValueError):  # no such message
                arrivals.append((name, types.decode(content, messages.kind_of(name))))
        return arrivals

    def connected(self) -> bool:
        """Whether anybody publishes any of the topics that are heard."""
        return self._connected > 0

    def close(self) -> None:
        """End the node: it signs off at its master when nothing more can come from here."""
        for stream in (self._node.stdin, self._node.stdout):
            if stream is not None:
                stream.close()
        try:
            self._node.wait(3.0)
        except subprocess.TimeoutExpired:
            self._node.kill()
            self._node.wait()

    def _hear_of_node(self, table: dict[str, Any]) -> None:
        self._connected = table.get("connected", self._connected)
        if "defined" in table:
            number, _, definition = table["defined"]
            kind = messages.kind_of(self._subscribed[number])
            self._defined[number] = messages.MessageTypes("ros1", {kind: definition})

    def _write(self) -> None:
        try:
            while self._waiting:
                del self._waiting[: os.write(self._into, self._waiting)]
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self._waiting.clear()  # `poll` tells

    def _arrived(self) -> Iterator[tuple[int, bytes]]:
        """What the node has said, whole."""
        while True:
            try:
                content = os.read(self._out, _READ)
            except BlockingIOError:
                break
            if not content:
                raise UserError(
                    f"the node of ROS 1 has ended (code {self._node.wait()}); its words stand above"
                )
            self._bytes += content
        while len(self._bytes) >= HEAD.size:
            number, length = HEAD.unpack_from(self._bytes)
            end = HEAD.size + length
            if len(self._bytes) < end:
                break
            content = bytes(self._bytes[HEAD.size : end])
            del self._bytes[:end]
            yield number, content

    def _await_node(self) -> None:
        """Until the node is there."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            ready = False
            for number, content in self._arrived():
                if number != TABLE:
                    continue  # others may already speak: too early
                table = json.loads(content)
                if "error" in table:
                    raise UserError(f"ROS 1: {table['error']}; {_HELP}")
                ready = ready or "ready" in table
                self._hear_of_node(table)  # what it says next may have come along
            if ready:
                return
            time.sleep(0.01)
        raise UserError(f"the node of ROS 1 did not start within {PATIENCE_S:g} s")

    def _described(self, name: str, as_published: bool = False) -> list[Any]:
        kind = messages.kind_of(name)
        definition, md5 = self.types.store.generate_msgdef(kind)
        if as_published:
            definition = md5 = ""
        return [name, kind.replace("/msg/", "/"), md5, definition, messages.is_latched(name)]


_HELP = (
    "start `roscore`, or give ROS_MASTER_URI; on Debian and Ubuntu `apt-get install python3-rospy"
    f" python3-roslaunch` brings rospy and roscore, and {PYTHON} names another Python that has it"
)


def _python() -> str:
    """The Python that has rospy. UserError."""
    wanted = os.environ.get(PYTHON)
    choices = [wanted] if wanted else ["/usr/bin/python3", shutil.which("python3") or ""]
    tried = list(dict.fromkeys(filter(None, choices)))
    for python in tried:
        command = [python, "-c", "import rospy"]
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            subprocess.run(
                command, capture_output=True, env=_environment(), timeout=PATIENCE_S, check=True
            )
            return python
    raise UserError(f"ROS 1 needs rospy, which {' and '.join(tried)} do not have; {_HELP}")


def _environment() -> dict[str, str]:
    """Without this Python's own paths, which are not for another; those of a ROS that was
    sourced stay.
    """
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    ros = os.pathsep.join(path for path in paths if path.startswith("/opt/ros"))
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "PYTHONHOME")
    }
    return environment | {"PYTHONPATH": ros, "PYTHONUNBUFFERED": "1"}
