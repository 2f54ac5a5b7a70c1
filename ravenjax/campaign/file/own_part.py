"""Finds and reads the Python files that a campaign names, and checks their hashes."""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from typing import TypeVar

from ravenjax.campaign.file.section import Section
from ravenjax.errors import UserError
from ravenjax.parts import part
from ravenjax.vocabulary.parts import OwnSource


def require_identifier(name: str) -> str:
    """The name itself; ValueError for one that cannot stand in paths of parameters."""
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) or keyword.iskeyword(name):
        raise ValueError(
            f"name = {name!r}, expected letters, digits and _, a letter first: paths of parameters"
            " have it"
        )
    return name


SHA256 = "^[0-9a-f]{64}$"
"""What the content of a file is known by."""
CONTENT = "and what it takes from its folder; another content is refused. Left out, any is taken"
"""What a key with such a number means, behind the file's name."""

AnySection = TypeVar("AnySection", bound=Section)

_KNOWN: dict[tuple[str, Path, str], OwnSource] = {}


def source(name: str, file: Path, sha256: str | None, what: str) -> OwnSource:
    """The code of a file, read again where it or a file that it imports has changed; what: kind
    of the part. Raises UserError for one that is unusable, or has another content than
    `sha256`.
    """
    key = name, file.absolute(), what
    code = _KNOWN.get(key)
    if code is None or not part.unchanged(code):
        code = _KNOWN[key] = part.read(*key)
    if sha256 not in (None, own := part.digest(code)):
        raise UserError(
            f"{file}: has changed since (sha256 {own[:16]}, expected {sha256[:16]}). "
            "Restore it, or run the campaign into another folder"
        )
    return code


def located(
    table: AnySection, folder: Path, what: str, name: str, key: str = "file", sha256: str = "sha256"
) -> AnySection:
    """A table whose file is taken from `folder` and known by its content; key, sha256: the keys
    of both.
    """
    file: Path | None = getattr(table, key)
    if file is None:
        return table
    path = folder.absolute() / file
    content = part.digest(source(name, path, getattr(table, sha256), what))
    return table.model_copy(update={key: path, sha256: content})
