"""Reads the commands of a session from JSON lines, each {"tick": ms, "message": {..}}.

With scenario and seed they reproduce the session.
"""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from ravenjax.errors import UserError
from ravenjax.train.protocol.messages import Command, Increments, Input

_HANDS: TypeAdapter[Input | Increments] = TypeAdapter(
    Annotated[Input | Increments, Field(discriminator="type")]
)


class _Line(BaseModel):
    tick: Annotated[int, Field(ge=0, strict=True)]
    message: Command


def read_commands(path: str | Path) -> list[tuple[int, Command]]:
    """Return the tick and the command of each line. Raises UserError if a line is invalid."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read: {error}. Expected JSON lines") from None
    commands = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entry = _Line.model_validate_json(line)
            if entry.message.get("type") in ("input", "increments"):
                _HANDS.validate_python(entry.message)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"])) or "the line"
            raise UserError(
                f"{path}:{number}: {where}: {first['msg']}. Expected"
                ' {"tick": ms, "message": {..}}'
            ) from None
        commands.append((entry.tick, entry.message))
    return commands
