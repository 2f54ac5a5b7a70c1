"""Exchanges ROS 1 messages with the system's rospy, which another Python runs in a node process.

The node only passes serialised messages on, so it needs no message packages. This process encodes
and decodes the messages.
"""

import contextlib
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train.robot_link.crtk import messages, ros1_node

PYTHON = "RAVENJAX_ROS1_PYTHON"
"""Environment variable with the Python that has rospy, if it is not the system's."""
PATIENCE_S = 20.0
_HELP = (
    "start `roscore`, or set ROS_MASTER_URI. On Debian and Ubuntu `apt-get install python3-rospy"
    f" python3-roslaunch` installs both. {PYTHON} may name another Python that has rospy"
)


class Ros1Transport:
    """Topics over ROS 1."""

    def __init__(self, published: Sequence[str], subscribed: Sequence[str]):
        """Raises UserError if rospy or its master is missing."""
        self.types = messages.message_types("ros1")
        self._published, self._subscribed = list(published), list(subscribed)
        # The last report of the node of each kind.
        self._reports: dict[str | int, Any] = {"connected": 0}
        # Message types as their publishers define them, by number of the topic.
        self._publisher_types: dict[int, messages.MessageTypes] = {}
        parent_end, node_end = socket.socketpair()
        with parent_end, node_end:
            self._node = subprocess.Popen(
                [_python(), str(Path(ros1_node.__file__)), str(node_end.fileno())],
                pass_fds=[node_end.fileno()],
                # ROS's output goes to standard error.
                stdout=2,
                env=_environment(),
                start_new_session=True,  # this process handles Ctrl-C
            )
            self._link = Connection(parent_end.detach())
        # Versions of raven2 define ravenstate differently, so its publisher's definition is used.
        subscriptions = [self._describe_topic(name, name == "ravenstate") for name in subscribed]
        try:
            self._link.send(([self._describe_topic(name) for name in published], subscriptions))
            end = time.monotonic() + PATIENCE_S
            while "ready" not in self._reports:  # messages that arrive meanwhile are dropped
                if not self._link.poll(max(0.0, end - time.monotonic())):
                    raise UserError(f"the node of ROS 1 did not start within {PATIENCE_S:g} s")
                self._receive()
        except BaseException:
            self.close()
            raise

    def publish(self, name: str, message: Any) -> None:
        """Send a message of `types` to the subscribers of the topic."""
        with contextlib.suppress(OSError):  # `poll` reports that the node has ended
            self._link.send((self._published.index(name), self.types.encode(message)))

    def poll(self) -> messages.Arrivals:
        """Return topic and message of each arrival. Raises UserError if the node has ended."""
        arrivals: messages.Arrivals = []
        while self._link.poll():
            number, content = self._receive()
            # A word instead of the topic's number is a report, which `_receive` has stored.
            if isinstance(number, int):
                name = self._subscribed[number]
                types = self._publisher_types.get(number, self.types)
                with contextlib.suppress(ValueError):  # not a valid message
                    arrivals.append((name, types.decode(content, messages.kind_of(name))))
        return arrivals

    def connected(self) -> bool:
        """Whether any of the subscribed topics has a publisher."""
        return self._reports["connected"] > 0

    def close(self) -> None:
        """End the node. It unregisters at the ROS master when the connection closes."""
        self._link.close()
        try:
            self._node.wait(3.0)
        except subprocess.TimeoutExpired:
            self._node.kill()
            self._node.wait()

    def _receive(self) -> tuple[Any, Any]:
        # Reads one pair from the node and stores its reports. Raises UserError if ROS 1 fails.
        try:
            word, content = self._link.recv()
        except (EOFError, OSError):
            code = self._node.wait()
            raise UserError(
                f"the node of ROS 1 ended with code {code}; see its message above"
            ) from None
        if word == "error":
            raise UserError(f"ROS 1: {content}: {_HELP}")
        self._reports[word] = content
        if word == "defined":
            number, definition = content
            kind = messages.kind_of(self._subscribed[number])
            self._publisher_types[number] = messages.MessageTypes("ros1", {kind: definition})
        return word, content

    def _describe_topic(self, name: str, as_published: bool = False) -> list[Any]:
        # Returns a topic as the node expects it: name, type, md5, definition, latched.
        kind = messages.kind_of(name)
        definition, md5 = self.types.store.generate_msgdef(kind)
        # Without an md5, the node accepts any definition, and sends the publisher's.
        if as_published:
            definition = md5 = ""
        return [name, kind.replace("/msg/", "/"), md5, definition, messages.is_latched(name)]


def _python() -> str:
    # Returns the path of a Python that has rospy, usually the system's.
    requested = os.environ.get(PYTHON)
    choices = [requested] if requested else ["/usr/bin/python3", shutil.which("python3") or ""]
    tried = list(dict.fromkeys(filter(None, choices)))
    for python in tried:
        command = [python, "-c", "import rospy"]
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            subprocess.run(
                command, capture_output=True, env=_environment(), timeout=PATIENCE_S, check=True
            )
            return python
    raise UserError(f"ROS 1 needs rospy, which is not in {' or '.join(tried)}: {_HELP}")


def _environment() -> dict[str, str]:
    """Return environment variables without the paths of this Python. ROS's own paths stay."""
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    ros = os.pathsep.join(path for path in paths if path.startswith("/opt/ros"))
    environment = {**os.environ, "PYTHONPATH": ros, "PYTHONUNBUFFERED": "1"}
    environment.pop("PYTHONHOME", None)
    return environment
