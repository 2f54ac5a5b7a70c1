"""Manages the open browser windows: their roles, their commands, and what each window receives.

The roles are operator, instructor and watcher. The hub checks types, ranges and size of every
message from a browser, and whether the role may send it. Operators receive no data about hazards.
As at a real console, they learn of a check only if it raises an alarm or stops the robot (event
"alarm"). In a blinded session, no window receives data that would show the group of the study. This
code runs in the server's event loop. A slow window skips frames and gets the newest frame.
"""

import asyncio
import contextlib
import dataclasses
import json
import time
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from ravenjax import resources
from ravenjax.store.ring import Ring, put_json
from ravenjax.train import protocol
from ravenjax.train.page import PageOptions, query_parameters, same_secret
from ravenjax.train.protocol import Command, Event, Frame, FrameLayout, Input, Json, Message
from ravenjax.train.robot import ROBOT

MAX_MESSAGE_BYTES = 2048  # The largest size of a message in bytes
MAX_NOTE_BYTES = 700  # The largest size of a note as JSON in bytes, so that an event can contain it
_COMMANDS = resources.read_tables(__file__, "commands.toml")
_VISIBLE: dict[str, list[str]] = _COMMANDS.pop("seen")
"""What operators see, and what blinding hides."""
MAX_MESSAGES_PER_S = 400
"""The largest rate of messages of one window; more than a gamepad at 144 Hz with all keys."""
KEPT_EVENTS = 1000
_COMMANDS_WITH_SENDER = ("operator", "seat")
"""Types of commands to which the hub adds the role of the window, if it is not the operator."""
LEFT_COMMAND = {"type": "seat", "do": "left"}
"""Command after the operator's window has closed: the pedal goes up, which is a release."""


class RefusedMessage(ValueError):
    """Raised when a message is dropped; its text is the reason."""


class BrowserCommand(Message):
    """Any message but the hands' input. Its keys depend on `do`."""

    type: Literal["operator", "instructor", "seat", "page"]
    do: str
    text: str | None = None
    to: Literal["nobody", "page", "itp", "crtk"] | None = None
    hazard: int | None = Field(None, ge=0)
    on: bool | None = None
    participant: str | None = Field(None, max_length=40)
    scenario: str | None = Field(None, pattern=r"^[A-Za-z0-9_]{1,60}$")
    seed: int | None = Field(None, ge=0, lt=2**31)
    name: str | None = Field(None, max_length=16)


_MESSAGE: TypeAdapter[Input | BrowserCommand] = TypeAdapter(
    Annotated[Input | BrowserCommand, Field(discriminator="type")]
)


@dataclasses.dataclass(frozen=True)
class Inbox:
    """Checks the messages of the browsers of one session."""

    arms: tuple[str, ...]
    hazards: int
    """Number of hazards in the session's list."""
    blinded: bool

    def read(self, message: str | bytes, role: str) -> Json:
        """Return a browser's message as a command of `protocol`, or as a message of type "page".
        Raises RefusedMessage if it is invalid, if this role may not send it, or if it does not fit
        the session. `commands.toml` lists the keys of each command and the roles that may send it.
        """
        if len(message) > MAX_MESSAGE_BYTES:
            raise RefusedMessage(f"got {len(message)} bytes, expected {MAX_MESSAGE_BYTES} at most")
        try:
            content = _MESSAGE.validate_json(message).model_dump(exclude_none=True)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            raise RefusedMessage(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        kind, action = content["type"], content.get("do", "")
        name, keys = f"{kind} {action}".rstrip(), content.keys() - {"type", "do"}
        rule = _COMMANDS[kind].get(action)
        if rule is None:
            raise RefusedMessage(f"got {name}, expected one of {', '.join(_COMMANDS[kind])}")
        if role not in rule["by"]:
            raise RefusedMessage(f"a {role} may not send {name}")
        required = rule.get("needs", [])
        allowed = [*required, *rule.get("may", [])]
        if not set(required) <= keys <= set(allowed):
            got, expected = " ".join(keys) or "nothing", " ".join(allowed) or "nothing"
            raise RefusedMessage(f"{name}: got {got}, expected {expected}")
        self._check_session(name, content)
        return content

    def _check_session(self, name: str, content: Json):
        # Refuses a message with numbers or names that this session does not have.
        for arm in content.get("arms", ()):
            if arm not in self.arms:
                raise RefusedMessage(f"got arm {arm}, expected {' or '.join(self.arms)}")
        if len(json.dumps(content.get("text", ""))) > MAX_NOTE_BYTES:
            raise RefusedMessage(f"got a note of more than {MAX_NOTE_BYTES} bytes")
        if name == "instructor cue" and self.blinded:
            raise RefusedMessage("the session is blinded, so instructors cannot set its cue")
        if content.get("hazard", -1) >= self.hazards:
            raise RefusedMessage(f"got hazard {content['hazard']}, expected < {self.hazards}")
        if "scenario" in content:
            # The scenario models are needed only once a session is over.
            from ravenjax.train.scenario import loading

            names = [path.stem for path in loading.bundled_scenarios()]
            if content["scenario"] not in names:
                raise RefusedMessage(
                    f"no scenario {content['scenario']}; there are {', '.join(names)}"
                )


@dataclasses.dataclass(frozen=True)
class Visibility:
    """What one role sees of one session."""

    layout: FrameLayout
    role: str
    blinded: bool

    def shows_event(self, event: Event) -> bool:
        """Whether this role may see an event. Nobody sees "hazard_row", or the cue if blinded."""
        kind = event.get("kind", "")
        if self.role == "instructor":
            return kind != "hazard_row" and not (self.blinded and kind == "cue")
        felt_kinds = [] if self.blinded else _VISIBLE["felt_events"]
        return kind in _VISIBLE["operators_events"] or kind in felt_kinds

    def header(self, header: Json) -> Json:
        """Return the entries of session.json that the role may see, and the scenario's texts."""
        hidden = [] if self.role == "instructor" else _VISIBLE["instructors_header"]
        if self.blinded:
            hidden = hidden + _VISIBLE["unblinded_header"]
        scenario = header.get("scenario") or {}
        texts = {name: scenario[name] for name in ("title", "description") if scenario.get(name)}
        return texts | {name: value for name, value in header.items() if name not in hidden}

    def frame(self, row: np.ndarray, extras: np.ndarray) -> bytes:
        """Return the bytes of a frame, float32: `extras` [arms, 5] (error_mm, force, desired x, y,
        z), then the row. Values that the role may not see are replaced. With the cue off,
        operators see no force; the instructor sees the force that the cue would have.
        """
        frame, extras = Frame(self.layout, row.copy()), extras.copy()
        is_felt = frame.number("cue_on") != 0
        # Operators of a blinded session must not know whether the cue is on.
        if self.blinded:
            frame["cue_on"] = 1
        if self.role != "instructor":
            frame["hazard"] = -1
            for name in _VISIBLE["instructors_channels"]:
                frame[name] = 0
            for i, arm in enumerate(self.layout.arms):
                for name in _VISIBLE["instructors_arm_channels"]:
                    frame[f"{arm}/{name}"] = 0
                if not is_felt:
                    extras[i, 1] = 0
                    frame[f"{arm}/force"] = 0
                # Operators of a blinded session see the robot's own pose in place of the model's.
                if self.blinded:
                    frame[f"{arm}/error_mm"] = extras[i, 0] = 0
                    frame[f"{arm}/model_jpos"] = frame[f"{arm}/link_jpos"]
                    frame[f"{arm}/model_tip"] = extras[i, 2:] = frame[f"{arm}/tip"]
        return np.concatenate([extras.ravel(), frame.row]).astype(np.float32).tobytes()


@dataclasses.dataclass(eq=False)
class Client:
    """The socket of one window."""

    connection: ServerConnection
    role: str
    window: str
    instructs: bool
    """Whether the window has the instructor's token."""

    def __post_init__(self) -> None:
        # What is not sent yet: texts, and the newest frame with its extras.
        self._texts: list[str] = []
        self._frame: tuple[np.ndarray, np.ndarray] | None = None
        self._wake = asyncio.Event()
        # How many messages the window may send now, and the time at which this was computed.
        self._allowance, self._updated_s = float(MAX_MESSAGES_PER_S), time.monotonic()

    def send_soon(self, message: Json) -> None:
        """Queue a text; texts are sent in order."""
        self._texts.append(protocol.encode(message))
        self._wake.set()

    def show(self, row: np.ndarray, extras: np.ndarray) -> None:
        """Queue a frame, float32 row, and its extras. They replace a frame that was not sent yet.
        Its peaks, the first two extras, stay visible: the greater value of both frames is sent.
        """
        if self._frame:
            extras = extras.copy()
            extras[:, :2] = np.maximum(extras[:, :2], self._frame[1][:, :2])
        self._frame = row, extras
        self._wake.set()

    def admits(self) -> bool:
        """Count a message, and return whether it is within the rate `MAX_MESSAGES_PER_S`."""
        now = time.monotonic()
        gained = (now - self._updated_s) * MAX_MESSAGES_PER_S
        self._allowance = min(MAX_MESSAGES_PER_S, self._allowance + gained)
        self._updated_s = now
        if self._allowance < 1:
            return False
        self._allowance -= 1
        return True

    async def send(self, visibility: Callable[[], Visibility]) -> None:
        """Send queued texts and frames until the socket closes."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            texts, self._texts = self._texts, []
            for text in texts:
                await self.connection.send(text)
            if self._frame:
                frame, self._frame = self._frame, None
                await self.connection.send(visibility().frame(*frame))


class Hub:
    """All windows of a session."""

    def __init__(
        self,
        options: PageOptions,
        place: Json,
        commands: Ring,
        on_page: Callable[[Client, Command], None],
        on_input: Callable[[], None],
    ):
        """place: positions of arms and tissue, by `scene.describe_field`. on_page: called with each
        message of type "page". on_input: called when the operator's input changes.
        """
        header, blinded = options.header, bool(options.header.get("blinded"))
        self._header, self._place, self._commands = header, place, commands
        self._layout = FrameLayout.of(options.arms)
        self._inbox = Inbox(options.arms, len(header.get("hazards", ())), blinded)
        self._on_page, self._on_input = on_page, on_input
        self._instructor_token = options.instructor_token
        self._scripted = "script" in header.get("consoles", ())
        self._visibility = {
            role: Visibility(self._layout, role, blinded)
            for role in ("operator", "watcher", "instructor")
        }
        self.clients: list[Client] = []
        # An event loop holds its tasks weakly, so this set keeps closing connections alive.
        self._closing: set[asyncio.Task[None]] = set()
        self._events: list[Event] = []
        self._last_input: Command = {}

    async def serve(self, connection: ServerConnection) -> None:
        """Serve one websocket, from its greeting to its end."""
        options = query_parameters(connection.request.path if connection.request else "")
        window = options.get("window", "")[:64]
        self._drop_earlier_connection(window)
        wants_to_instruct = options.get("role") == "instructor"
        token = options.get("instructor_token", "")
        instructs = wants_to_instruct and same_secret(token, self._instructor_token)
        # A second instructor begins as a watcher and takes over only by a message of their own.
        if instructs and not self._has("instructor"):
            role = "instructor"
        else:
            role = "watcher" if wants_to_instruct or not self._seat_is_free() else "operator"
        client = Client(connection, role, window, instructs)
        self._greet(client)
        self.clients.append(client)
        sender = asyncio.create_task(client.send(lambda: self._visibility[client.role]))
        try:
            # When the window closes, `_remove` releases its pedal.
            with contextlib.suppress(ConnectionClosed):
                async for message in connection:
                    self._receive(client, message)
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await sender
            self._remove(client)

    def show(self, row: np.ndarray, extras: np.ndarray) -> None:
        """Queue a new frame (float32) and its extras for every window; see `Visibility.frame`."""
        for client in self.clients:
            client.show(row, extras)

    def announce(self, events: list[Event]) -> None:
        """Queue new events of the session for the windows that may see them."""
        self._events = [*self._events, *events][-KEPT_EVENTS:]
        for client in self.clients:
            for event in self._visible(client, events):
                client.send_soon({"type": "event", **event})

    def _visible(self, client: Client, events: list[Event]) -> list[Event]:
        """Return the events that a window may see, without their key "row": a row of hazards.csv
        shows whether the cue is on, which blinding hides.
        """
        shown = filter(self._visibility[client.role].shows_event, events)
        return [{key: value for key, value in event.items() if key != "row"} for event in shown]

    def _remove(self, client: Client):
        # Removes a window. If it was the operator's, its pedal goes up and its seat is free.
        if client not in self.clients:
            return
        self.clients.remove(client)
        was_operator = client.role == "operator"
        # Messages that the window sent before may still arrive, and must not move the robot.
        client.role = "watcher"
        if was_operator:
            self._forward(LEFT_COMMAND)
            self._announce_seat()

    def _drop_earlier_connection(self, window: str):
        """Drop the earlier connection of a window that connects again. It may have failed."""
        # A window without a name cannot be recognized.
        same_window = [client for client in self.clients if window and client.window == window]
        for client in same_window:
            self._remove(client)
            close = client.connection.close(reason="the window is on another connection")
            closing = asyncio.create_task(close)
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)

    def _has(self, role: str) -> bool:
        return any(client.role == role for client in self.clients)

    def _seat_is_free(self) -> bool:
        return not (self._scripted or self._has("operator"))

    def _greet(self, client: Client):
        # Sends a new page all that it needs to draw the session.
        places = {
            name: [place.start, place.stop - place.start]
            for name, place in self._layout.places.items()
        }
        client.send_soon(
            {
                "type": "welcome",
                "role": client.role,
                "instructs": client.instructs,
                "header": self._visibility[client.role].header(self._header),
                **self._place,
                "arms": self._layout.arms,
                "layout": places,
                "size": self._layout.size,
                "run_levels": ROBOT.run_levels,
                "phases": protocol.PHASES,
                "views": protocol.VIEWS,
                "consoles": protocol.CONSOLES,
                "stale_ms": protocol.STALE_MS,
                "events": self._visible(client, self._events),
            }
        )

    def _announce_seat(self):
        for client in self.clients:
            if client.role == "watcher":
                client.send_soon({"type": "seat", "free": self._seat_is_free()})

    def _receive(self, client: Client, message: str | bytes):
        # Checks a window's message, and carries it out or forwards it to the session.
        if not client.admits():
            return
        try:
            command = self._inbox.read(message, client.role)
        except RefusedMessage as reason:
            client.send_soon({"type": "refused", "why": str(reason)})
            return
        if command["type"] == "page":
            self._change_role(client, command)
        elif client.role != "operator" and command["type"] in _COMMANDS_WITH_SENDER:
            self._forward({**command, "by": client.role})
        else:
            self._forward(command)

    def _change_role(self, client: Client, command: Command):
        # Gives a window the role that it requests, or passes other requests to the page.
        match command["do"]:
            case "instruct":
                if client.instructs:
                    client.role = "instructor"
                    self._greet(client)
            case "take":
                if self._seat_is_free():
                    client.role = "operator"
                    self._greet(client)
                    self._announce_seat()
            case _:
                self._on_page(client, command)

    def _forward(self, command: Command):
        put_json(self._commands, command)
        if command["type"] == "input" and command != self._last_input:
            self._last_input = command
            self._on_input()
