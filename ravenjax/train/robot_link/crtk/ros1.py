"""ROS 1 by the system's rospy: a node of its own, run by the Python that has it, beside this
process.

Only bytes pass between the two: `messages` makes and reads them here, so that the node needs no
message packages.
"""

from __future__ import annotations

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
"""Environment variable: the Python that has rospy, where it is not the system's."""
PATIENCE_S = 20.0


class Ros1Transport:
    """Topics over ROS 1."""

    def __init__(self, published: Sequence[str], subscribed: Sequence[str]) -> None:
        """UserError where rospy or its master is missing."""
        self.types = messages.types("ros1")
        self._published, self._subscribed = list(published), list(subscribed)
        self._connected, self._is_ready = 0, False
        self._defined: dict[int, messages.MessageTypes] = {}  # as their publishers have them
        ours, theirs = socket.socketpair()
        with ours, theirs:
            self._node = subprocess.Popen(
                [_python(), str(Path(ros1_node.__file__)), str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                # What ROS prints goes to the standard error.
                stdout=2,
                env=_environment(),
                start_new_session=True,  # Ctrl-C is this process's to take
            )
            self._link = Connection(ours.detach())
        # Versions of ravenstate differ: its publisher says how it is defined.
        heard = [self._described(name, name == "ravenstate") for name in subscribed]
        try:
            self._link.send(([self._described(name) for name in published], heard))
            self._await_node()
        except BaseException:
            self.close()
            raise

    def publish(self, name: str, message: Any) -> None:
        """Send a message of `types` to whoever subscribes to the topic."""
        with contextlib.suppress(OSError):  # `poll` tells that the node has ended
            self._link.send((self._published.index(name), self.types.encode(message)))

    def poll(self) -> list[tuple[str, Any]]:
        """Topic and message of what has come. UserError where the node has ended."""
        arrivals: list[tuple[str, Any]] = []
        while self._link.poll():
            number, content = self._receive()
            if isinstance(number, int):
                name, types = self._subscribed[number], self._defined.get(number, self.types)
                with contextlib.suppress(ValueError):  # no such message
                    arrivals.append((name, types.decode(content, messages.kind_of(name))))
        return arrivals

    def connected(self) -> bool:
        """Whether anybody publishes any of the topics that are heard."""
        return self._connected > 0

    def close(self) -> None:
        """End the node: it signs off at its master when nothing more can come from here."""
        self._link.close()
        try:
            self._node.wait(3.0)
        except subprocess.TimeoutExpired:
            self._node.kill()
            self._node.wait()

    def _receive(self) -> tuple[Any, Any]:
        """What the node says next, and what that changes here."""
        try:
            word, content = self._link.recv()
        except (EOFError, OSError):
            code = self._node.wait()
            raise UserError(
                f"the node of ROS 1 has ended (code {code}); its words stand above"
            ) from None
        if word == "error":
            raise UserError(f"ROS 1: {content}; {_HELP}")
        if word == "ready":
            self._is_ready = True
        elif word == "connected":
            self._connected = content
        elif word == "defined":
            number, definition = content
            kind = messages.kind_of(self._subscribed[number])
            self._defined[number] = messages.MessageTypes("ros1", {kind: definition})
        return word, content

    def _await_node(self) -> None:
        """Until the node is there; messages that come before it says so are too early."""
        end = time.monotonic() + PATIENCE_S
        while not self._is_ready:
            if not self._link.poll(max(0.0, end - time.monotonic())):
                raise UserError(f"the node of ROS 1 did not start within {PATIENCE_S:g} s")
            self._receive()

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
