"""What a browser may say, checked before anything is passed on: types, ranges, sizes, roles."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LARGEST = 2048
"""Bytes of one message at most."""
NOTE = 700
"""Bytes of a note as JSON at most: it must fit in an event."""

Speed = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]
Axes = Annotated[list[Speed], Field(min_length=3, max_length=3)]


class RefusedMessage(ValueError):
    """The message is dropped; says why."""


class Message(BaseModel):
    """What a browser sends."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Hand(Message):
    """Speeds of one hand, shares of the greatest."""

    move: Axes = [0.0, 0.0, 0.0]
    turn: Axes = [0.0, 0.0, 0.0]
    grasp: Speed = 0.0


class Input(Message):
    """The operator's hands and pedal."""

    type: Literal["input"]
    source: Literal["keyboard", "mouse", "gamepad"]
    pedal: bool
    arms: dict[Literal["gold", "green"], Hand]


class Command(Message):
    """Anything else; which keys it has depends on what it is to do."""

    type: Literal["operator", "instructor", "seat", "page"]
    do: str
    text: str | None = None
    to: Literal["nobody", "page", "itp", "crtk"] | None = None
    hazard: Annotated[int, Field(ge=0)] | None = None
    on: bool | None = None
    participant: Annotated[str, Field(max_length=40)] | None = None
    scenario: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,60}$")] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None
    name: Annotated[str, Field(max_length=16)] | None = None
    stamp: Annotated[float, Field(allow_inf_nan=False)] | None = None


_MESSAGE: TypeAdapter[Input | Command] = TypeAdapter(
    Annotated[Input | Command, Field(discriminator="type")]
)
_EVERYBODY = "operator watcher instructor"
# Who may send a command, the keys that it must have, and others that it may have. An E-stop is the
# safe direction, open to whoever looks.
_COMMANDS = {
    **dict.fromkeys(
        ["operator restart", "operator rehearse", "operator reengage", "operator discard"],
        ("operator", "", ""),
    ),
    "operator estop": (_EVERYBODY, "", ""),
    "operator note": ("operator instructor", "text", ""),
    "seat take": ("operator", "", ""),
    "seat give": ("operator instructor", "to", ""),
    **{
        f"instructor {do}": ("instructor", "", "")
        for do in ("start", "disarm", "pause", "resume", "reset", "end")
    },
    "instructor arm": ("instructor", "hazard", ""),
    "instructor cue": ("instructor", "on", ""),
    "instructor next": ("instructor", "", "participant scenario seed"),
    "page camera": (_EVERYBODY, "name", ""),
    "page shadows": (_EVERYBODY, "on", ""),
    "page ping": (_EVERYBODY, "", "stamp"),
    "page take": ("watcher", "", ""),
    "page instruct": ("watcher", "", ""),
}


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
            content = _MESSAGE.validate_json(message).model_dump(exclude_none=True)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            raise RefusedMessage(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        name = f"{content['type']} {content.get('do', '')}".rstrip()
        keys = content.keys() - {"type", "do"}
        if name == "input":
            roles, required, optional = "operator", " ".join(keys), ""
        elif name in _COMMANDS:
            roles, required, optional = _COMMANDS[name]
        else:
            raise RefusedMessage(f"got {name}, expected one of {', '.join(_COMMANDS)}")
        if role not in roles.split():
            raise RefusedMessage(f"a {role} may not send {name}")
        if not set(required.split()) <= keys <= set(f"{required} {optional}".split()):
            expected = f"{required} {optional}".strip() or "nothing"
            raise RefusedMessage(f"{name}: got {' '.join(keys) or 'nothing'}, expected {expected}")
        self._require_sense(name, content)
        return content

    def _require_sense(self, name: str, content: dict[str, Any]) -> None:
        """The message fits this session."""
        for arm in content.get("arms", ()):
            if arm not in self._arms:
                raise RefusedMessage(f"arm {arm}, the session has {' and '.join(self._arms)}")
        if len(json.dumps(content.get("text", ""))) > NOTE:
            raise RefusedMessage(f"a note of more than {NOTE} bytes")
        if name == "instructor cue" and self._blinded:
            raise RefusedMessage("the session is blinded: its cue is not the instructor's")
        if content.get("hazard", -1) >= self._hazards:
            raise RefusedMessage(f"hazard {content['hazard']}, the session has {self._hazards}")
        if "scenario" in content:
            # The models of a scenario are needed only once a session is over.
            from ravenjax.train.scenario import loading

            names = [path.stem for path in loading.bundled()]
            if content["scenario"] not in names:
                raise RefusedMessage(
                    f"no scenario {content['scenario']}; there are {', '.join(names)}"
                )
