"""Defines the record of a user's Python file that a campaign names: its name, path and content."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class OwnSource:
    """The code of a user's file; static. Equal objects have equal code."""

    name: str  # name of the check, detector or harm in its campaign
    path: str  # path of the file, for error messages
    text: str  # content of the file
    # (name, content) of each file in the same folder that it loads or imports
    files: tuple[tuple[str, bytes], ...] = dataclasses.field(default=(), repr=False)
