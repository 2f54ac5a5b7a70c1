"""What was said to a session: with scenario and seed the whole of it. Kept in memory as JSON, and
written to a file that can be played again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, StrictBool, TypeAdapter, ValidationError

from ravenjax.errors import UserError, shown
from ravenjax.train.robot import ArmName, unit

MOST_COMMANDS = 1_000_000
"""Commands that are kept: hours of a page's, a quarter of an hour of a console's that sends one
a millisecond.
"""


class CommandLog:
    """Commands with the tick that each came in: iterated, pairs of both."""

    def __init__(self) -> None:
        self._lines: list[bytes] = []

    def add(self, tick: int, commands: list[dict[str, Any]]) -> None:
        """What was said in a tick."""
        for command in commands:
            if len(self._lines) < MOST_COMMANDS:
                self._lines.append(json.dumps([tick, command], separators=(",", ":")).encode())

    def clear(self) -> None:
        """Forget all."""
        self._lines.clear()

    def __iter__(self) -> Iterator[tuple[int, dict[str, Any]]]:
        return ((tick, command) for tick, command in map(json.loads, self._lines))


# 1e9 keeps whole numbers exact and squares finite.
_Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False, strict=True)]
_Vector = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_Turn = Annotated[list[_Number], Field(min_length=4, max_length=4)]


class _Hand(BaseModel, extra="forbid"):
    move: _Vector = []
    turn: _Vector = []
    grasp: _Number = 0.0


class _Increment(BaseModel, extra="forbid"):
    delta_um: _Vector
    quat: Annotated[_Turn, AfterValidator(unit)] = []
    grasp_mrad: _Number = 0.0


class _Input(BaseModel):
    type: Literal["input"]
    pedal: StrictBool
    arms: dict[ArmName, _Hand]


class _Increments(BaseModel):
    type: Literal["increments"]
    pedal: StrictBool
    arms: dict[ArmName, _Increment]


_HANDS: TypeAdapter[_Input | _Increments] = TypeAdapter(
    Annotated[_Input | _Increments, Field(discriminator="type")]
)
_EXPECTED = 'expected {"tick": ms, "message": {..}}'


def write_commands(path: Path, commands: Iterable[tuple[int, Mapping[str, Any]]]) -> None:
    """Write commands as JSON lines, {"tick": ms, "message": {..}} each."""
    with open(path, "w", encoding="utf-8") as file:
        for tick, message in commands:
            line = {"tick": tick, "message": message}
            file.write(json.dumps(line, separators=(",", ":")) + "\n")


def read_commands(path: str | Path) -> list[tuple[int, dict[str, Any]]]:
    """Tick and command of each line of such a file. UserError where one is none."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read: {error}. Expected JSON lines") from None
    commands = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entry = json.loads(line)
            tick, message = entry["tick"], entry["message"]
            if type(tick) is not int or tick < 0 or not isinstance(message, dict):
                raise ValueError(_EXPECTED)
            if message.get("type") in ("input", "increments"):
                _HANDS.validate_python(message)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise UserError(f"{path}:{number}: {where}: {first['msg']}") from None
        except (ArithmeticError, LookupError, TypeError, ValueError, RecursionError):
            raise UserError(f"{path}:{number}: got {shown(line)}, {_EXPECTED}") from None
        commands.append((tick, message))
    return commands
