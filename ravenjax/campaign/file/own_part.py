"""Files of one's own that a campaign names: where they lie, and by which content they are known."""

from __future__ import annotations

import keyword
import re
from pathlib import Path

from ravenjax.errors import UserError
from ravenjax.parts import part
from ravenjax.vocabulary.parts import OwnSource

IDENTIFIER = re.compile(rf"(?!(?:{'|'.join(keyword.kwlist)})$)[A-Za-z][A-Za-z0-9_]*")
"""Name of a part whose parameters a campaign may vary: it stands in their paths."""

SHA256 = "^[0-9a-f]{64}$"
"""What the content of a file is known by."""
CONTENT = "and what it takes from its folder; another content is refused. Left out, any is taken"
"""What a key with such a number means, behind the file's name."""


def source(name: str, file: Path, sha256: str | None, what: str = "detector") -> OwnSource:
    """The code of a file. Raises UserError for one that is unusable, or has another content than
    `sha256`.
    """
    code = _read(name, file.absolute(), what)
    if sha256 not in (None, own := part.digest(code)):
        raise UserError(
            f"{file}: has changed since (sha256 {own[:16]}, expected {sha256[:16]}). "
            "Restore it, or run the campaign into another folder"
        )
    return code


def _read(name: str, path: Path, what: str) -> OwnSource:
    """A file as it is now; read anew where it, or what it takes from beside it, has changed."""
    code = _KNOWN.get((name, path, what))
    if code is None or not part.unchanged(code):
        code = _KNOWN[name, path, what] = part.read(name, path, what)
    return code


_KNOWN: dict[tuple[str, Path, str], OwnSource] = {}
