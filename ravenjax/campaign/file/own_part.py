"""Finds and reads the user's Python files that a campaign names, and checks their hashes."""

import keyword
import re
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AfterValidator, Field

from ravenjax import consent
from ravenjax.campaign.file.section import Section
from ravenjax.errors import UserError, require_utf8
from ravenjax.parts import part
from ravenjax.vocabulary.parts import OwnSource


def require_identifier(name: str) -> str:
    """Return the name. Raise ValueError if it cannot be part of a parameter's path."""
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) or keyword.iskeyword(name):
        raise ValueError(
            f"got name = {name!r}, expected only letters, digits and _, with a letter first,"
            " because paths of parameters contain the name"
        )
    return name


OwnName = Annotated[str, AfterValidator(require_identifier), Field(max_length=60)]
"""The name of a user's check, detector or harm."""

SHA256 = "^[0-9a-f]{64}$"
"""Pattern of the hash that identifies the content of a file."""
CONTENT = "and the files of its folder that it loads. Other content is refused; default: accept any"
"""Description of a key with such a hash, after the name of the file."""
Sha256 = Annotated[str | None, Field(pattern=SHA256, description=f"hash of that file {CONTENT}")]
"""The hash of a user's Python file."""

AnySection = TypeVar("AnySection", bound=Section)

_READ_FILES: dict[tuple[str, Path, str], OwnSource] = {}


def own_source(name: str, file: Path, sha256: str | None, what: str) -> OwnSource:
    """Return the code of a user's file. name: of the part in the campaign. what: kind of the part,
    such as "check". Files are cached, and a changed file is read again. Raise UserError if
    the file cannot be used, if the user has not agreed to run it, or if its hash is not `sha256`.
    """
    key = name, file.absolute(), what
    require_utf8(str(key[1]))
    code = _READ_FILES.get(key)
    if code is None or not part.is_unchanged(code):
        code = _READ_FILES[key] = part.read_source(*key, consent.require_consent)
    content_hash = part.hash_source(code)
    if sha256 not in (None, content_hash):
        raise UserError(
            f"{file}: has changed since the campaign began (sha256 {content_hash[:16]}, expected"
            f" {sha256[:16]}). Restore it, or run the campaign into another folder"
        )
    return code


def locate_part(
    table: AnySection, folder: Path, what: str, name: str, key: str = "file", sha256: str = "sha256"
) -> AnySection:
    """Return a copy of a table with the absolute path of its Python file in `folder`, and with the
    hash of the file. what: kind of the part, such as "check". name: of the part. key, sha256: the
    table's keys for path and hash.
    """
    file: Path | None = getattr(table, key)
    if file is None:
        return table
    path = folder.absolute() / file
    code = own_source(name, path, getattr(table, sha256), what)
    return table.model_copy(update={key: path, sha256: part.hash_source(code)})
