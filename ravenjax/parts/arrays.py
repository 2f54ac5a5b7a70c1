"""Arrays beside a part's file: fixed weights, tables of numbers."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.vocabulary.parts import OwnSource


class _Place(NamedTuple):
    """What `load` works on while a part is read."""

    folder: Path
    hashes: dict[str, str]  # sha256 of what it has loaded, by name
    before: Mapping[str, str]  # sha256 of what it loaded in another process, by name


_PLACES: list[_Place] = []
_CONTENTS: dict[str, bytes] = {}
"""What was loaded, by its sha256: another process has no need of the files."""


@contextlib.contextmanager
def beside(path: Path, before: Iterable[tuple[str, str]] = ()) -> Iterator[dict[str, str]]:
    """Let `load` find the files beside `path`; gives the sha256 of each that it loaded, by name.

    before: (name, sha256) of files that are taken as they were, from what `keep` got.
    """
    place = _Place(path.parent, {}, dict(before))
    _PLACES.append(place)
    try:
        yield place.hashes
    finally:
        _PLACES.remove(place)


def contents(sources: Iterable[OwnSource]) -> dict[str, bytes]:
    """What these parts have loaded, by its sha256."""
    return {sha256: _CONTENTS[sha256] for source in sources for _, sha256 in source.files}


def keep(contents: Mapping[str, bytes]) -> None:
    """Let parts load what another process has loaded."""
    _CONTENTS.update(contents)


def load(name: str) -> Any:
    """The arrays of a NumPy file (.npy: one array, .npz: a dict of arrays) in the folder of the part that calls.

    Its content counts as the part's own: a campaign with other weights is another campaign. Call it at the top of the
    file. Raises UserError where there is no such file.
    """
    if not _PLACES:
        raise UserError(f"load({name!r}) was called outside a part's file, or in its functions; call it at its top")
    place = _PLACES[-1]
    path = place.folder / name
    try:
        content = _CONTENTS[place.before[name]] if name in place.before else path.read_bytes()
        arrays = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = getattr(error, "strerror", None) or f"no NumPy file of numbers: {shown(str(error))}"
        raise UserError(f"{path}: cannot be loaded ({reason})") from None
    sha256 = hashlib.sha256(content).hexdigest()
    place.hashes[name], _CONTENTS[sha256] = sha256, content
    return dict(arrays) if isinstance(arrays, np.lib.npyio.NpzFile) else arrays
