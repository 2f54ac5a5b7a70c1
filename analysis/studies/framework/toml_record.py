"""A record from the text of a TOML file, with an error that names file and place."""

from __future__ import annotations

import tomllib
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from ravenjax.errors import UserError

_R = TypeVar("_R", bound=BaseModel)


def read(model: type[_R], text: str, where: str) -> _R:
    """`text` as a `model`; UserError for what is no TOML or no such record, where `where` names
    the file.
    """
    try:
        return model.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{where}: not valid TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the file"
        raise UserError(f"{where}: {place}: {first['msg']}; got {first['input']!r}") from None
