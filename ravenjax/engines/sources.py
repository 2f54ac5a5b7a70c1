"""The files that decide what is traced and printed: those of this package's lower floors, and
the robots' models.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from ravenjax.bundled import resources

_PACKAGE = Path(__file__).resolve().parents[1]
_FLOORS = ("engines", "stages", "faults", "ir", "numbers", "vocabulary", "robots")


def digest() -> str:
    """sha256 over their names and contents, as they are now."""
    files = [path for floor in _FLOORS for path in sorted((_PACKAGE / floor).rglob("*.py"))]
    models = [*sorted(Path("models").rglob("*")), *resources.bundled("models", "**/*")]
    own = hashlib.sha256()
    for path in (*files, *(path for path in models if path.is_file())):
        name = path.relative_to(_PACKAGE) if path.is_relative_to(_PACKAGE) else path.name
        own.update(f"{name}\0{path.stat().st_size}\0".encode() + path.read_bytes())
    return own.hexdigest()


AT_IMPORT = digest()
"""Of the files as they were when this module was imported: what the process runs, if they have
not changed since.
"""


def unchanged() -> bool:
    """Whether they are still as they were: only then is it known what the process runs."""
    return digest() == AT_IMPORT
