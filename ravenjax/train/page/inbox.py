"""Checks every message of a browser before it is forwarded: types, ranges, sizes, roles."""

import json
import tomllib
from importlib import resources
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from ravenjax.train.protocol.messages import Input, Json, Message

LARGEST = 2048
"""The largest size of a message in bytes."""
NOTE = 700
"""The largest size of a note as JSON in bytes: it must fit in an event."""


class RefusedMessage(ValueError):
    """Raised when a message is dropped; its text is the reason."""


class Command(Message):
    """Any message but the hands' input. Its keys depend on `do`."""

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


_MESSAGE: TypeAdapter[Input | Command] = TypeAdapter(
    Annotated[Input | Command, Field(discriminator="type")]
)
_COMMANDS: dict[str, dict[str, dict[str, list[str]]]] = tomllib.loads(
    resources.files("ravenjax.train.page").joinpath("commands.toml").read_text(encoding="utf-8")
)


class Inbox:
    """The checks for one session."""

    def __init__(self, arms: tuple[str, ...], hazards: int, blinded: bool) -> None:
        """hazards: number of hazards in the session's list."""
        self._arms, self._hazards, self._blinded = arms, hazards, blinded

    def read(self, message: str | bytes, role: str) -> Json:
        """Return the message as in `messages`, or one of type "page". Raises RefusedMessage."""
        if len(message) > LARGEST:
            raise RefusedMessage(f"{len(message)} bytes, expected {LARGEST} at most")
        try:
            content = _MESSAGE.validate_json(message).model_dump(exclude_none=True)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            raise RefusedMessage(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        kind, do = content["type"], content.get("do", "")
        name, keys = f"{kind} {do}".rstrip(), content.keys() - {"type", "do"}
        if kind == "input":
            rule = {"by": ["operator"], "may": [*keys]}
        elif do in _COMMANDS[kind]:
            rule = _COMMANDS[kind][do]
        else:
            raise RefusedMessage(f"got {name}, expected one of {', '.join(_COMMANDS[kind])}")
        if role not in rule["by"]:
            raise RefusedMessage(f"a {role} may not send {name}")
        needs = rule.get("needs", [])
        known = [*needs, *rule.get("may", [])]
        if not set(needs) <= keys <= set(known):
            got, expected = " ".join(keys) or "nothing", " ".join(known) or "nothing"
            raise RefusedMessage(f"{name}: got {got}, expected {expected}")
        self._require_sense(name, content)
        return content

    def _require_sense(self, name: str, content: Json) -> None:
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
            # The scenario models are needed only once a session is over.
            from ravenjax.train.scenario import loading

            names = [path.stem for path in loading.bundled_scenarios()]
            if content["scenario"] not in names:
                raise RefusedMessage(
                    f"no scenario {content['scenario']}; there are {', '.join(names)}"
                )
