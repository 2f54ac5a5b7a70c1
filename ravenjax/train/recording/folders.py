"""Reads the sessions in a folder, in the order in which they began."""

from dataclasses import dataclass
from pathlib import Path

from ravenjax.errors import StoreError
from ravenjax.store.logs.session import description
from ravenjax.train.protocol import Json


@dataclass(frozen=True)
class SessionFolder:
    """A session's folder and its session.json."""

    path: Path
    header: Json

    @property
    def scenario(self) -> str:
        return (self.header.get("scenario") or {}).get("name") or ""

    @property
    def participant(self) -> str:
        """The participant; "" if not named."""
        return self.header.get("participant") or ""

    @property
    def started(self) -> str:
        """Time of the start, UTC, ISO 8601; "" if not known."""
        return self.header.get("started") or ""

    @property
    def summary(self) -> Json:
        """The summary that the session wrote when it ended."""
        return self.header.get("summary") or {}


def sessions_beside(base: Path) -> list[SessionFolder]:
    """Return the undamaged sessions in the folders of `base`, the first begun first."""
    sessions = []
    for file in sorted(Path(base).glob(f"*/{description.FILE}")):
        try:
            sessions.append(SessionFolder(file.parent, description.read_session(file.parent)))
        except StoreError:
            continue
    return sorted(sessions, key=lambda session: (session.started, session.path.name))
