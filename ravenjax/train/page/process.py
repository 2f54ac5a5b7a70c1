"""The page's process: polls the rings, draws, and tells the windows."""

from __future__ import annotations

import contextlib
import io
import logging
import multiprocessing
import signal
import threading
import time

import numpy as np

from ravenjax.train.page.aim import Aim
from ravenjax.train.page.cameras import Windows
from ravenjax.train.page.door import Door
from ravenjax.train.page.hub import Hub
from ravenjax.train.page.inbox import Inbox
from ravenjax.train.page.options import PageOptions
from ravenjax.train.page.server import Server
from ravenjax.train.page.site import PageSite
from ravenjax.train.page.world import World, place
from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.protocol.jaws import with_tips
from ravenjax.train.realtime.ring import Ring, read_json

PROMPT_S = 0.004  # between frames while the answer to a key is awaited
ANSWER_S = 0.06
PARENT_S = 1.0


def run(options: PageOptions) -> None:
    """See the package."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C is the session's to take; it ends the page in its own time
    page = Page(options)
    try:
        page.work()
    finally:
        page.close()


class Page:
    """Everything of the process, put together."""

    def __init__(self, options: PageOptions) -> None:
        """Attach to the rings, bind the port, and say which it is."""
        self._options = options
        self._layout = FrameLayout.of(options.arms)
        self._frames, self._events = Ring.attach(options.frames), Ring.attach(options.events)
        self._commands = Ring.attach(options.commands)
        self._next_event = 0
        self._seen = 0  # frames
        self._answer_until = 0.0
        self._changed = threading.Event()
        blinded = bool(options.header.get("blinded"))
        inbox = Inbox(options.arms, len(options.header.get("hazards", ())), blinded)
        self._windows = Windows()
        self._aims = {arm: Aim(arm) for arm in options.arms}
        self._hub = Hub(
            options.header,
            place(options.arms),
            self._layout,
            self._commands,
            inbox,
            self._windows.obey,
            self._await_answer,
            options.instructor_token,
        )
        door = Door(options.host, options.token)
        logging.getLogger("websockets").setLevel(
            logging.CRITICAL
        )  # refusals are counted, not printed
        self._server = Server(
            options.host,
            options.port,
            door,
            PageSite(door, options.folder, options.instructor_token),
            self._hub.serve,
        )
        self._windows.watch(self._server.viser)
        self._world = World(self._server.viser, options.arms, options.header.get("task"), blinded)
        if options.port_taken is not None:
            options.port_taken.send(self._server.port)
            options.port_taken.close()

    def work(self) -> None:
        """Until the session's process is gone."""
        period = 1.0 / self._options.fps
        last_frame = last_check = time.monotonic()
        while True:
            now = time.monotonic()
            self._tell()
            if now >= last_frame + period - 1e-3:
                last_frame = now
                self._draw()
            parent = multiprocessing.parent_process()
            if now > last_check + PARENT_S:
                last_check = now
                if parent is not None and not parent.is_alive():
                    return
            self._changed.wait(
                PROMPT_S
                if now < self._answer_until
                else max(0.0, last_frame + period - time.monotonic())
            )
            self._changed.clear()

    def close(self) -> None:
        """Stop serving and let go of the rings."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser says good-bye
            self._server.viser.stop()
        self._frames.close()
        self._events.close()
        self._commands.close()

    def _tell(self) -> None:
        """What is new, to the windows."""
        first, rows = self._events.read(self._next_event)
        if len(rows):
            self._next_event = first + len(rows)
            events = list(read_json(rows))
            for event in events:
                self._world.tell(event)
            self._server.loop.call_soon_threadsafe(self._hub.tell, events)
        _, rows = self._frames.read(self._seen)
        if len(rows):
            self._seen = self._frames.written
            if self._hub.open:
                frames = rows.view(np.float32)
                row = with_tips(self._layout, frames[-1])
                self._server.loop.call_soon_threadsafe(self._hub.show, row, self._extras(frames))

    def _extras(self, frames: np.ndarray) -> np.ndarray:
        """[arms, 5]: greatest error_mm and force of these frames, for a peak of one millisecond is
        to be seen; then the tip that the software wants, m, in the arm's frame 0."""
        out = np.zeros((len(self._layout.arms), 5), np.float32)
        for i, arm in enumerate(self._layout.arms):
            out[i, 0] = frames[:, self._layout.places[f"{arm}/error_mm"]].max()
            out[i, 1] = np.linalg.norm(frames[:, self._layout.places[f"{arm}/force"]], axis=1).max()
            out[i, 2:] = self._aims[arm].tip(frames[-1, self._layout.places[f"{arm}/jpos_d"]])
        return out

    def _draw(self) -> None:
        if self._frames.written and self._server.watching:
            _, rows = self._frames.read(self._frames.written - 1)
            if len(rows):
                self._world.update(
                    Frame(self._layout, with_tips(self._layout, rows[-1].view(np.float32)))
                )

    def _await_answer(self) -> None:
        self._answer_until = time.monotonic() + ANSWER_S
        self._changed.set()
