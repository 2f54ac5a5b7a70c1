"""The windows that are open: who drives, who instructs, who looks on; what they say and what they
are told.

Everything here runs in the server's event loop. A window that takes frames slowly gets the newest,
never a backlog.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from ravenjax.robots.raven2 import ROBOT
from ravenjax.train.page.door import query
from ravenjax.train.page.inbox import Inbox, RefusedMessage
from ravenjax.train.page.sight import Sight
from ravenjax.train.protocol import messages
from ravenjax.train.protocol.frame import CONSOLES, PHASES, VIEWS, FrameLayout
from ravenjax.train.realtime.ring import Ring, put_json

MOST_PER_S = 400  # messages of one window; a gamepad at 144 Hz with all keys stays below
KEPT_EVENTS = 1000
_SIGNED = ("operator", "seat")
"""Commands that say which role they come from, where that is not the operator."""
LEFT = {"type": "seat", "do": "left"}
"""What is said for an operator whose window is gone: its pedal is up, which counts as a release."""


class Client:
    """One window's socket."""

    def __init__(
        self, connection: ServerConnection, role: str, window: str, instructs: bool
    ) -> None:
        """instructs: whether it has shown that it may, though another may do so now."""
        self.connection, self.role, self.window, self.instructs = (
            connection,
            role,
            window,
            instructs,
        )
        self._texts: list[str] = []
        self._frame: tuple[np.ndarray, np.ndarray] | None = None
        self._wake = asyncio.Event()
        self._room, self._counted = float(MOST_PER_S), time.monotonic()

    def tell(self, told: dict[str, Any]) -> None:
        """Send a text, in order."""
        self._texts.append(json.dumps(told, separators=(",", ":")))
        self._wake.set()

    def show(self, row: np.ndarray, extras: np.ndarray) -> None:
        """Send a frame, in place of one that still waits."""
        if self._frame:
            extras = np.column_stack(
                [np.maximum(extras[:, :2], self._frame[1][:, :2]), extras[:, 2:]]
            )
        self._frame = row, extras
        self._wake.set()

    def admits(self) -> bool:
        """Whether one more message is within the window's rate."""
        now = time.monotonic()
        self._room = min(MOST_PER_S, self._room + (now - self._counted) * MOST_PER_S)
        self._counted = now
        if self._room < 1:
            return False
        self._room -= 1
        return True

    async def send(self, sight: Callable[[], Sight]) -> None:
        """Until the socket closes."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            texts, self._texts = self._texts, []
            for text in texts:
                await self.connection.send(text)
            if self._frame:
                frame, self._frame = self._frame, None
                await self.connection.send(sight().frame(*frame))


class Hub:
    """All windows of a session."""

    def __init__(
        self,
        header: dict[str, Any],
        place: dict[str, Any],
        layout: FrameLayout,
        commands: Ring,
        inbox: Inbox,
        on_page: Callable[[Client, dict[str, Any]], None],
        on_input: Callable[[], None],
        instructor_token: str | None = None,
    ) -> None:
        """place: what a window needs to draw tips itself. instructor_token: None: nobody instructs.

        on_page: takes what is for the page's process itself; on_input: called where the operator's
        input changes.
        """
        self._header, self._place, self._layout = header, place, layout
        self._commands, self._inbox = commands, inbox
        self._on_page, self._on_input = on_page, on_input
        self._instructor_token = instructor_token
        self._scripted = "script" in header.get("consoles", ())
        blinded = bool(header.get("blinded"))
        self._sights = {
            role: Sight(layout, role, blinded) for role in ("operator", "watcher", "instructor")
        }
        self._clients: list[Client] = []
        self._closing: set[asyncio.Task[None]] = (
            set()
        )  # connections; who else holds a task is its event loop, weakly
        self._events: list[dict[str, Any]] = []
        self._last_input: dict[str, Any] = {}
        self.dropped: Counter[str] = Counter()

    async def serve(self, connection: ServerConnection) -> None:
        """One websocket, from its greeting to its end."""
        options = query(connection.request.path if connection.request else "")
        window = options.get("window", "")[:64]
        self._forget(window)
        asks = options.get("role") == "instructor"
        instructs = asks and self._may_instruct(options.get("instructor_token", ""))
        role = self._free_chair() if instructs else "watcher" if asks else self._free_seat()
        client = Client(connection, role, window, instructs)
        self._greet(client)
        self._clients.append(client)
        sender = asyncio.create_task(client.send(lambda: self._sights[client.role]))
        try:
            async for message in connection:
                self._take(client, message)
        except ConnectionClosed:
            pass  # a tab that vanished; what it held is let go below
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await sender
            self._part(client)

    def show(self, row: np.ndarray, extras: np.ndarray) -> None:
        """A new frame (float32) and what belongs to it, see `Sight.frame`."""
        for client in self._clients:
            client.show(row, extras)

    def tell(self, events: list[dict[str, Any]]) -> None:
        """New events of the session."""
        self._events = [*self._events, *events][-KEPT_EVENTS:]
        for client in self._clients:
            for event in events:
                if self._sights[client.role].event(event.get("kind", "")):
                    client.tell({"type": "event", **event})

    @property
    def open(self) -> int:
        """Windows."""
        return len(self._clients)

    def _part(self, client: Client) -> None:
        """The window is gone, or another connection has come in its place."""
        if client in self._clients:
            self._clients.remove(client)
            drove, client.role = (
                client.role == "operator",
                "watcher",
            )  # what it has said before may arrive yet
            if drove:
                self._forward(LEFT)
                self._seat_told()

    def _forget(self, window: str) -> None:
        """A window that comes back may be there still, on a connection that has died unheard."""
        for client in [one for one in self._clients if window and one.window == window]:
            self._part(client)
            closing = asyncio.create_task(
                client.connection.close(reason="the window is on another connection")
            )
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)

    def _may_instruct(self, token: str) -> bool:
        expected = self._instructor_token
        return expected is not None and hmac.compare_digest(token.encode(), expected.encode())

    def _free_seat(self) -> str:
        if self._scripted or any(client.role == "operator" for client in self._clients):
            return "watcher"
        return "operator"

    def _free_chair(self) -> str:
        """The instructor's: a second one sits down beside the first only by a word of their own."""
        return (
            "watcher"
            if any(client.role == "instructor" for client in self._clients)
            else "instructor"
        )

    def _greet(self, client: Client) -> None:
        sight = self._sights[client.role]
        places = {
            name: [place.start, place.stop - place.start]
            for name, place in self._layout.places.items()
        }
        client.tell(
            {
                "type": "welcome",
                "role": client.role,
                "instructs": client.instructs,
                "header": sight.header(self._header),
                **self._place,
                "arms": self._layout.arms,
                "layout": places,
                "size": self._layout.size,
                "run_levels": ROBOT.run_levels,
                "phases": PHASES,
                "views": VIEWS,
                "consoles": CONSOLES,
                "stale_ms": messages.STALE_MS,
                "events": [event for event in self._events if sight.event(event.get("kind", ""))],
            }
        )

    def _seat_told(self) -> None:
        free = self._free_seat() == "operator"
        for client in self._clients:
            if client.role == "watcher":
                client.tell({"type": "seat", "free": free})

    def _take(self, client: Client, message: str | bytes) -> None:
        if not client.admits():
            self.dropped["too many"] += 1
            return
        try:
            content = self._inbox.read(message, client.role)
        except RefusedMessage as reason:
            self.dropped["refused"] += 1
            client.tell({"type": "refused", "why": str(reason), "dropped": self.dropped["refused"]})
            return
        if content["type"] == "page":
            self._page(client, content)
        else:
            by = (
                {}
                if client.role == "operator" or content["type"] not in _SIGNED
                else {"by": client.role}
            )
            self._forward({**content, **by})

    def _page(self, client: Client, told: dict[str, Any]) -> None:
        if told["do"] == "ping":
            client.tell(
                {
                    "type": "pong",
                    "stamp": told.get("stamp", 0.0),
                    "dropped": sum(self.dropped.values()),
                }
            )
        elif told["do"] == "instruct":
            if client.instructs:
                client.role = "instructor"
                self._greet(client)
        elif told["do"] != "take":
            self._on_page(client, told)
        elif self._free_seat() == "operator":
            client.role = "operator"
            self._greet(client)
            self._seat_told()

    def _forward(self, told: dict[str, Any]) -> None:
        put_json(self._commands, told)
        if told["type"] == "input" and told != self._last_input:
            self._last_input = told
            self._on_input()
