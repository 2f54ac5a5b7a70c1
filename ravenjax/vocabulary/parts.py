"""Users' files: Python files that a campaign names and that are traced into the tick."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class OwnSource:
    """The code of a part; static. Equal sources are equal code."""

    name: str  # of the part in its campaign
    path: str  # of the file, for errors
    text: str  # what stands in it
    # (name, content) of each file beside it that it loads or imports
    files: tuple[tuple[str, bytes], ...] = dataclasses.field(default=(), repr=False)
