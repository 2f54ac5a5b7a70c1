"""Arrays beside a part's file: fixed weights, tables of numbers."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from ravenjax.errors import UserError, shown
from ravenjax.parts import files


def load(name: str) -> Any:
    """The arrays of a NumPy file (.npy: one array, .npz: a dict of arrays) in the folder of the
    part that calls.

    Its content counts as the part's own: a campaign with other weights is another campaign. Call it
    at the top of the file. Raises UserError where there is no such file.
    """
    if not files.reading():
        raise UserError(
            f"load({name!r}) was called outside a part's file, or in its functions; call it at"
            " its top"
        )
    try:
        arrays = np.load(io.BytesIO(files.content(name)), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = (
            getattr(error, "strerror", None) or f"no NumPy file of numbers: {shown(str(error))}"
        )
        raise UserError(f"{files.folder() / name}: cannot be loaded ({reason})") from None
    return dict(arrays) if isinstance(arrays, np.lib.npyio.NpzFile) else arrays
