"""What a browser may say, checked before anything is passed on: types, ranges, sizes, roles."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LARGEST = 2048  # bytes of one message
NOTE = 700  # bytes of a note as JSON: it must fit in an event


_Speed = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]
_Axes = Annotated[list[_Speed], Field(min_length=3, max_length=3)]


class RefusedMessage(ValueError):
    """The message is dropped; says why."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class _Hand(_Message):
    move: _Axes = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    turn: _Axes = Field(default_factory=lambda: [0.0, 0.0, 0.0])
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


class Inbox:
    """The checks for one session."""

    def __init__(self, arms: tuple[str, ...], hazards: int, blinded: bool) -> None:
        """hazards: how many the session's list has."""
        self._arms, self._hazards, self._blinded = arms, hazards, blinded

    def read(self, message: str | bytes, role: str) -> dict[str, Any]:
        """The message as `messages` describes it, or one of "page". Raises Refused."""
        if len(message) > LARGEST:
            raise RefusedMessage(f"{len(message)} bytes, expected {LARGEST} at most")
        try:
            content = _ANY.validate_json(message)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            raise RefusedMessage(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        except RecursionError:
            raise RefusedMessage("nested too deep") from None
        if not _may(role, content):
            raise RefusedMessage(
                f"a {role} may not send {content.type} {getattr(content, 'do', '')}".rstrip()
            )
        return self._sense(content)

    def _sense(self, told: _Message) -> dict[str, Any]:
        if isinstance(told, _Input):
            strange = [arm for arm in told.arms if arm not in self._arms]
            if strange:
                raise RefusedMessage(
                    f"arm {strange[0]}, the session has {' and '.join(self._arms)}"
                )
        if isinstance(told, _Operator):
            if (told.do == "note") != (told.text is not None):
                raise RefusedMessage("a note has a text, and nothing else has")
            if told.text is not None and len(json.dumps(told.text)) > NOTE:
                raise RefusedMessage(f"a note of more than {NOTE} bytes")
        if isinstance(told, _Seat) and (told.do == "give") != (told.to is not None):
            raise RefusedMessage("`to` belongs to give")
        if isinstance(told, _Instructor):
            if told.do == "cue" and self._blinded:
                raise RefusedMessage("the session is blinded: its cue is not the instructor's")
            if (told.do == "cue") != (told.on is not None) or (told.do == "arm") != (
                told.hazard is not None
            ):
                raise RefusedMessage("`on` belongs to cue, `hazard` to arm")
            if told.do != "next" and (told.participant, told.scenario, told.seed) != (
                None,
                None,
                None,
            ):
                raise RefusedMessage("`participant`, `scenario` and `seed` belong to next")
            if told.scenario is not None:
                from ravenjax.train.scenario import (
                    loading,
                )  # the models of a scenario: only once a session is over

                names = [path.stem for path in loading.bundled()]
                if told.scenario not in names:
                    raise RefusedMessage(
                        f"no scenario {told.scenario}; there are {', '.join(names)}"
                    )
            if told.hazard is not None and told.hazard >= self._hazards:
                raise RefusedMessage(f"hazard {told.hazard}, the session has {self._hazards}")
        return told.model_dump(exclude_none=True)


def _may(role: str, told: Any) -> bool:
    if isinstance(told, _Page):
        return told.do not in ("take", "instruct") or role == "watcher"
    if isinstance(told, _Operator) and told.do == "estop":
        return True  # the safe direction is open to whoever looks
    if isinstance(told, _Instructor):
        return role == "instructor"
    if isinstance(told, _Operator) and told.do == "note":
        return role != "watcher"
    if isinstance(told, _Seat) and told.do == "give":
        return role != "watcher"
    return role == "operator"
