"""Runs the page's process: polls the rings, draws the scene, and informs the windows."""

import contextlib
import io
import logging
import signal
import socket
import threading
import time
from multiprocessing.connection import Connection

import numpy as np

from ravenjax.train.page import PageOptions
from ravenjax.train.page.hub import Hub
from ravenjax.train.page.scene import Scene, Windows, describe_place
from ravenjax.train.page.server import PageServer
from ravenjax.train.protocol import Frame, FrameLayout, closing_point, with_tips
from ravenjax.train.realtime.ring import Ring, parent_has_ended, read_json
from ravenjax.train.robot import tip_pose

# Interval between frames while the answer to a key is awaited, and duration of that wait.
PROMPT_S, ANSWER_S = 0.004, 0.06
PERIOD_S = 1 / 60
"""Interval between frames at other times."""


def serve_page(options: PageOptions, listening: socket.socket, ready: Connection) -> None:
    """Serve the page at a listening socket. Send its port through `ready` once it is served."""
    # The session handles Ctrl-C, and ends the page when it is ready.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.closing(Page(options, listening)) as page:
        ready.send(listening.getsockname()[1])
        ready.close()
        page.work()


class Page:
    """The parts of the page's process."""

    def __init__(self, options: PageOptions, listening: socket.socket) -> None:
        self._layout = FrameLayout.of(options.arms)
        self._frames, self._events, commands = self._rings = [
            Ring.attach(name) for name in (options.frames, options.events, options.commands)
        ]
        self._next_event = 0
        self._frames_seen = 0
        self._answer_until = 0.0
        self._changed = threading.Event()
        windows = Windows()
        self._hub = Hub(
            options, describe_place(options.arms), commands, windows.obey, self._await_answer
        )
        # Refused connections are not logged.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        self._server = PageServer(options, listening, self._hub.serve)
        windows.watch(self._server.viser)
        header = options.header
        blinded = bool(header.get("blinded"))
        self._scene = Scene(self._server.viser, options.arms, header.get("task"), blinded)

    def work(self) -> None:
        last_frame = time.monotonic()
        while not parent_has_ended():
            now = time.monotonic()
            self._pass_on()
            if now >= last_frame + PERIOD_S - 1e-3:
                last_frame = now
                self._draw()
            until_frame = max(0.0, last_frame + PERIOD_S - time.monotonic())
            self._changed.wait(PROMPT_S if now < self._answer_until else until_frame)
            self._changed.clear()

    def close(self) -> None:
        # viser prints a message when it stops.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.viser.stop()
        for ring in self._rings:
            ring.close()

    def _pass_on(self) -> None:
        call_soon = self._server.loop.call_soon_threadsafe
        first, rows = self._events.read(self._next_event)
        if len(rows):
            self._next_event = first + len(rows)
            events = list(read_json(rows))
            for event in events:
                self._scene.follow(event)
            call_soon(self._hub.announce, events)
        _, rows = self._frames.read(self._frames_seen)
        if len(rows):
            self._frames_seen = self._frames.written
            if self._hub.open:
                frames = rows.view(np.float32)
                row = with_tips(self._layout, frames[-1])
                call_soon(self._hub.show, row, self._extras(frames))

    def _extras(self, frames: np.ndarray) -> np.ndarray:
        """Return float32 [arms, 5]: greatest error_mm and force of these frames, then the desired
        tip.

        The greatest values let a peak of one millisecond be seen. The tip is the software's, m, in
        the arm's frame 0.
        """
        out = np.zeros((len(self._layout.arms), 5), np.float32)
        for i, arm in enumerate(self._layout.arms):
            error, force, wanted = (
                frames[:, self._layout.places[f"{arm}/{name}"]]
                for name in ("error_mm", "force", "jpos_d")
            )
            out[i, 0] = error.max()
            out[i, 1] = np.linalg.norm(force, axis=1).max()
            joints = wanted[-1].tolist()
            out[i, 2:] = closing_point(arm, tip_pose(arm, joints)[0].tolist(), joints)
        return out

    def _draw(self) -> None:
        if self._frames.written and self._server.watching:
            _, rows = self._frames.read(self._frames.written - 1)
            if len(rows):
                row = with_tips(self._layout, rows[-1].view(np.float32))
                self._scene.update(Frame(self._layout, row))

    def _await_answer(self) -> None:
        self._answer_until = time.monotonic() + ANSWER_S
        self._changed.set()
