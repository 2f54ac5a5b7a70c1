"""Files beside a part's own that are part of its content: arrays that it loads, modules that it
imports.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from ravenjax.vocabulary.parts import OwnSource


class _Place(NamedTuple):
    """Where the files are taken from while a part is read."""

    folder: Path
    hashes: dict[str, str]  # sha256 of what was taken, by name
    before: (
        Mapping[str, str] | None
    )  # sha256 of what was taken when the part was first read: nothing else is now


_PLACES: list[_Place] = []
_CONTENTS: dict[str, bytes] = {}
"""What was taken, by its sha256: another process has no need of the files."""


@contextlib.contextmanager
def beside(path: Path, before: Iterable[tuple[str, str]] | None = None) -> Iterator[dict[str, str]]:
    """Let `content` find the files beside `path`; gives the sha256 of each that is taken, by name.

    before: (name, sha256) of all files of a part that was read before, maybe in another process;
    they are taken as they were.
    """
    place = _Place(path.parent, {}, None if before is None else dict(before))
    _PLACES.append(place)
    try:
        yield place.hashes
    finally:
        _PLACES.remove(place)


def reading() -> bool:
    """Whether a part is being read."""
    return bool(_PLACES)


def folder() -> Path:
    """Of the part that is being read."""
    return _PLACES[-1].folder


def content(name: str) -> bytes:
    """What is in a file beside the part that is being read; it is part of its content from now
    on. Raises OSError.
    """
    place = _PLACES[-1]
    if place.before is None:
        data = (place.folder / name).read_bytes()
    elif name in place.before:
        data = _CONTENTS[place.before[name]]
    else:
        raise FileNotFoundError(2, "No such file when the part was first read", name)
    sha256 = hashlib.sha256(data).hexdigest()
    place.hashes[name], _CONTENTS[sha256] = sha256, data
    return data


def contents(sources: Iterable[OwnSource]) -> dict[str, bytes]:
    """What these parts have taken, by its sha256."""
    return {sha256: _CONTENTS[sha256] for source in sources for _, sha256 in source.files}


def keep(contents: Mapping[str, bytes]) -> None:
    """Let parts take what another process has taken."""
    _CONTENTS.update(contents)
