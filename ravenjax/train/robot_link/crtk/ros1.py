"""ROS 1 by the system's rospy: a node of its own, run by the Python that has it, beside this
process.

Only bytes pass between the two: `messages` makes and reads them here, so that the node needs no
message packages.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train.robot_link.crtk import messages, ros1_node
from ravenjax.train.robot_link.crtk.names import RosTopic
from ravenjax.train.robot_link.crtk.ros1_node import HEAD, TABLE

PYTHON = "RAVENJAX_ROS1_PYTHON"
"""Environment variable: the Python that has rospy, where it is not the system's."""
PATIENCE_S = 20.0
_ROOM = 1 << 16
"""Bytes that wait for the node; what does not fit is dropped whole."""
_READ = 1 << 16


class Ros1Transport:
    """Topics over ROS 1. `publish` and `poll` never wait."""

    ros: messages.Ros = "ros1"

    def __init__(
        self, published: Sequence[RosTopic], subscribed: Sequence[RosTopic], name: str = "ravenjax"
    ) -> None:
        """UserError where rospy or its master is missing."""
        self.types = messages.types("ros1")
        self.unsent = 0
        self.garbled = 0
        self._numbers = {one.name: (number, one.kind) for number, one in enumerate(published)}
        self._heard = list(subscribed)
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
            "name": name,
            "published": [self._described(one) for one in published],
            "subscribed": [self._described(one) for one in subscribed],
        }
        content = json.dumps(table).encode()
        try:
            os.write(
                self._into, HEAD.pack(TABLE, len(content)) + content
            )  # blocks until it is taken
            self._await()
        except BaseException:
            self.close()
            raise
        os.set_blocking(self._into, False)

    def publish(self, name: str, message: Any) -> None:
        """Send a message of `types` to whoever subscribes to the topic."""
        number, kind = self._numbers[name]
        content = self.types.encode(message, kind)
        if len(self._waiting) + len(content) > _ROOM:
            self.unsent += 1
            return
        self._waiting += HEAD.pack(number, len(content)) + content
        self._write()

    def poll(self) -> list[tuple[str, Any]]:
        """Topic and message of what has come. UserError where the node has ended."""
        self._write()
        arrivals: list[tuple[str, Any]] = []
        for number, content in self._arrived():
            if number == TABLE:
                self._hear_of_node(json.loads(content))
                continue
            topic = self._heard[number]
            types = self._defined.get(number, self.types)
            try:
                arrivals.append((topic.name, types.decode(content, topic.kind)))
            except ValueError:
                self.garbled += 1
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
            self._defined[number] = messages.MessageTypes(
                "ros1", {self._heard[number].kind: definition}
            )

    def _write(self) -> None:
        try:
            while self._waiting:
                del self._waiting[: os.write(self._into, self._waiting)]
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self._waiting.clear()  # `poll` tells

    def _arrived(self) -> list[tuple[int, bytes]]:
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
        chunks: list[tuple[int, bytes]] = []
        at = 0
        while len(self._bytes) - at >= HEAD.size:
            number, length = HEAD.unpack_from(self._bytes, at)
            end = at + HEAD.size + length
            if len(self._bytes) < end:
                break
            chunks.append((number, bytes(self._bytes[at + HEAD.size : end])))
            at = end
        del self._bytes[:at]
        return chunks

    def _await(self) -> None:
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

    def _described(self, topic: RosTopic) -> list[Any]:
        definition, md5 = self.types.store.generate_msgdef(topic.kind)
        if topic.as_published:
            definition = md5 = ""
        return [topic.name, topic.kind.replace("/msg/", "/"), md5, definition, topic.latched]


_HELP = (
    "start `roscore`, or give ROS_MASTER_URI; on Debian and Ubuntu `apt-get install python3-rospy"
    f" python3-roslaunch` brings rospy and roscore, and {PYTHON} names another Python that has it"
)


def _python() -> str:
    """The Python that has rospy. UserError."""
    wanted = os.environ.get(PYTHON)
    choices = [wanted] if wanted else ["/usr/bin/python3", shutil.which("python3")]
    tried: list[str] = []
    for python in choices:
        if python is None or python in tried:
            continue
        tried.append(python)
        try:
            command = [python, "-c", "import rospy"]
            trial = subprocess.run(
                command, capture_output=True, env=_environment(), timeout=PATIENCE_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired):
            continue
        if trial.returncode == 0:
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
