"""Arrays beside a part's file: fixed weights, tables of numbers."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown

_PLACES: list[tuple[Path, dict[str, str]]] = []
"""Folder of the part that is being read, and the hashes of what it has loaded, by name."""


@contextlib.contextmanager
def beside(path: Path) -> Iterator[dict[str, str]]:
    """Let `load` find the files beside `path`; gives the sha256 of each that it loaded, by name."""
    place = path.parent, {}
    _PLACES.append(place)
    try:
        yield place[1]
    finally:
        _PLACES.remove(place)


def load(name: str) -> Any:
    """The arrays of a NumPy file (.npy: one array, .npz: a dict of arrays) in the folder of the part that calls.

    Its content counts as the part's own: a campaign with other weights is another campaign. Call it at the top of the
    file. Raises UserError where there is no such file.
    """
    if not _PLACES:
        raise UserError(f"load({name!r}) was called outside a part's file, or in its functions; call it at its top")
    folder, hashes = _PLACES[-1]
    path = folder / name
    try:
        content = path.read_bytes()
        arrays = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = getattr(error, "strerror", None) or f"no NumPy file of numbers: {shown(str(error))}"
        raise UserError(f"{path}: cannot be loaded ({reason})") from None
    hashes[name] = hashlib.sha256(content).hexdigest()
    return dict(arrays) if isinstance(arrays, np.lib.npyio.NpzFile) else arrays
