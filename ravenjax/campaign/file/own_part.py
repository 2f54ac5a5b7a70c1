"""Finds and reads the user's Python files that a campaign names, and checks their hashes."""

import keyword
import re
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AfterValidator, Field

from ravenjax import consent
from ravenjax.campaign.file.section import Section
from ravenjax.errors import UserError
from ravenjax.parts import part
from ravenjax.vocabulary.parts import OwnSource


def require_identifier(name: str) -> str:
    """Return the name. Raises ValueError if it cannot be part of a parameter's path."""
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) or keyword.iskeyword(name):
        raise ValueError(
            f"name = {name!r}, expected letters, digits and _, a letter first, because it is part"
            " of parameter paths"
        )
    return name


OwnName = Annotated[str, AfterValidator(require_identifier), Field(max_length=60)]
"""The name of a user's part."""

SHA256 = "^[0-9a-f]{64}$"
"""Pattern of the hash that identifies the content of a file."""
CONTENT = "and what it takes from its folder; another content is refused. Left out, any is taken"
"""Description of a key that holds such a hash; the file's name precedes it."""
Sha256 = Annotated[str | None, Field(pattern=SHA256, description=f"of that file {CONTENT}")]
"""The hash of the file of a table."""

AnySection = TypeVar("AnySection", bound=Section)

_KNOWN: dict[tuple[str, Path, str], OwnSource] = {}


def part_source(name: str, file: Path, sha256: str | None, what: str) -> OwnSource:
    """Return the code of a file. It is read again if it or a file that it imports has changed.

    what: kind of the part. Raises UserError if the file is unusable, its code must not run
    (`consent`), or its content does not match `sha256`.
    """
    key = name, file.absolute(), what
    code = _KNOWN.get(key)
    if code is None or not part.is_unchanged(code):
        code = _KNOWN[key] = part.read_source(*key, consent.require_consent)
    if sha256 not in (None, own := part.hash_source(code)):
        raise UserError(
            f"{file}: has changed since (sha256 {own[:16]}, expected {sha256[:16]}). "
            "Restore it, or run the campaign into another folder"
        )
    return code


def locate_part(
    table: AnySection, folder: Path, what: str, name: str, key: str = "file", sha256: str = "sha256"
) -> AnySection:
    """Return a table with its file located in `folder` and the hash of its content.

    key, sha256: the table's keys of both.
    """
    file: Path | None = getattr(table, key)
    if file is None:
        return table
    path = folder.absolute() / file
    content = part.hash_source(part_source(name, path, getattr(table, sha256), what))
    return table.model_copy(update={key: path, sha256: content})
