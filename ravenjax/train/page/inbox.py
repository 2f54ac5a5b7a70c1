"""What a browser may say, checked before anything is passed on: types, ranges, sizes, roles."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LARGEST = 2048
"""Bytes of one message at most."""
NOTE = 700
"""Bytes of a note as JSON at most: it must fit in an event."""

_Speed = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]
_Axes = Annotated[list[_Speed], Field(min_length=3, max_length=3)]


class RefusedMessage(ValueError):
    """The message is dropped; says why."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class _Hand(_Message):
    move: _Axes = [0.0, 0.0, 0.0]
    turn: _Axes = [0.0, 0.0, 0.0]
    grasp: _Speed = 0.0


class _Input(_Message):
    type: Literal["input"]
    source: Literal["keyboard", "mouse", "gamepad"]
    pedal: bool
    arms: dict[Literal["gold", "green"], _Hand]


class _Operator(_Message):
    type: Literal["operator"]
    do: Literal["estop", "restart", "rehearse", "reengage", "discard", "note"]
    text: str | None = None


class _Instructor(_Message):
    type: Literal["instructor"]
    do: Literal["start", "arm", "disarm", "pause", "resume", "reset", "end", "cue", "next"]
    hazard: Annotated[int, Field(ge=0)] | None = None
    on: bool | None = None
    participant: Annotated[str, Field(max_length=40)] | None = None
    scenario: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,60}$")] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None


class _Seat(_Message):
    """Who drives."""

    type: Literal["seat"]
    do: Literal["take", "give"]
    to: Literal["nobody", "page", "itp", "crtk"] | None = None


class _Page(_Message):
    """For the page's process itself."""

    type: Literal["page"]
    do: Literal["camera", "layer", "take", "instruct", "ping"]
    name: Annotated[str, Field(max_length=16)] | None = None
    on: bool | None = None
    stamp: Annotated[float, Field(allow_inf_nan=False)] | None = None


_ANY: TypeAdapter[_Input | _Operator | _Instructor | _Seat | _Page] = TypeAdapter(
    Annotated[_Input | _Operator | _Instructor | _Seat | _Page, Field(discriminator="type")]
)
_NEEDED = {("operator", "note"): {"text"}, ("seat", "give"): {"to"}} | {
    ("instructor", "cue"): {"on"},
    ("instructor", "arm"): {"hazard"},
}
"""Keys that a command must have; others it must not have."""
_OPTIONAL = {"instructor": {"next": {"participant", "scenario", "seed"}}}
_EVERYBODY = {("page", "camera"), ("page", "layer"), ("page", "ping"), ("operator", "estop")}
"""Commands of every role: an E-stop is the safe direction, open to whoever looks."""
_NOT_WATCHERS = {("operator", "note"), ("seat", "give")}


class Inbox:
    """The checks for one session."""

    def __init__(self, arms: tuple[str, ...], hazards: int, blinded: bool) -> None:
        """hazards: how many the session's list has."""
        self._arms, self._hazards, self._blinded = arms, hazards, blinded

    def read(self, message: str | bytes, role: str) -> dict[str, Any]:
        """The message as `messages` describes it, or one of "page". Raises RefusedMessage."""
        if len(message) > LARGEST:
            raise RefusedMessage(f"{len(message)} bytes, expected {LARGEST} at most")
        try:
            content = _ANY.validate_json(message)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            raise RefusedMessage(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        except RecursionError:
            raise RefusedMessage("nested too deep") from None
        command = content.model_dump(exclude_none=True)
        kind, do = content.type, command.get("do", "")
        if not _may_send(role, kind, do):
            raise RefusedMessage(f"a {role} may not send {kind} {do}".rstrip())
        if kind in ("operator", "seat", "instructor"):
            _require_keys(kind, do, command.keys() - {"type", "do"})
        self._require_sense(command)
        return command

    def _require_sense(self, command: dict[str, Any]) -> None:
        for arm in command.get("arms", ()):
            if arm not in self._arms:
                raise RefusedMessage(f"arm {arm}, the session has {' and '.join(self._arms)}")
        if len(json.dumps(command.get("text", ""))) > NOTE:
            raise RefusedMessage(f"a note of more than {NOTE} bytes")
        if (command["type"], command.get("do")) == ("instructor", "cue") and self._blinded:
            raise RefusedMessage("the session is blinded: its cue is not the instructor's")
        if command.get("hazard", -1) >= self._hazards:
            raise RefusedMessage(f"hazard {command['hazard']}, the session has {self._hazards}")
        if "scenario" in command:
            # The models of a scenario are needed only once a session is over.
            from ravenjax.train.scenario import loading

            names = [path.stem for path in loading.bundled()]
            if command["scenario"] not in names:
                raise RefusedMessage(
                    f"no scenario {command['scenario']}; there are {', '.join(names)}"
                )


def _may_send(role: str, kind: str, do: str) -> bool:
    if (kind, do) in _EVERYBODY:
        return True
    if (kind, do) in _NOT_WATCHERS:
        return role != "watcher"
    return role == {"page": "watcher", "instructor": "instructor"}.get(kind, "operator")


def _require_keys(kind: str, do: str, keys: set[str]) -> None:
    needed = _NEEDED.get((kind, do), set())
    allowed = needed | _OPTIONAL.get(kind, {}).get(do, set())
    if not needed <= keys <= allowed:
        got = ", ".join(sorted(keys)) or "nothing"
        wanted = ", ".join(sorted(allowed)) or "nothing"
        raise RefusedMessage(f"{kind} {do}: got {got}, expected {wanted}")
