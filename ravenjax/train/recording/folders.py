"""Sessions that lie beside one another: what their folders say, in the order in which they
began.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ravenjax.errors import StoreError
from ravenjax.store.logs.session import description


@dataclass(frozen=True)
class SessionFolder:
    """A session's folder and its session.json."""

    path: Path
    header: dict[str, Any]

    @property
    def scenario(self) -> str:
        """Name of its scenario."""
        content = self.header.get("scenario")
        return str(content.get("name") or "") if isinstance(content, dict) else str(content or "")

    @property
    def participant(self) -> str:
        """The participant; "": not named."""
        return str(self.header.get("participant") or "")

    @property
    def started(self) -> str:
        """UTC, ISO 8601; "": not known."""
        return str(self.header.get("started") or "")

    @property
    def summary(self) -> dict[str, Any]:
        """What it left when it ended."""
        return self.header.get("summary") or {}


def beside(base: Path) -> list[SessionFolder]:
    """The sessions in the folders of `base`, the first begun first; what is no session, or
    damaged, is left out.
    """
    sessions = []
    for file in sorted(Path(base).glob(f"*/{description.FILE}")):
        try:
            sessions.append(SessionFolder(file.parent, description.read(file.parent)))
        except StoreError:
            continue
    return sorted(sessions, key=lambda one: (one.started, one.path.name))
