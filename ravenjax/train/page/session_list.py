"""The sessions that lie beside the present one, as a page: who, what, when, score, debrief."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

from ravenjax.train.recording import folders
from ravenjax.train.recording.folders import SessionFolder

DEBRIEF = "debrief.html"


class SessionList:
    """The session folders of one folder."""

    def __init__(self, base: Path) -> None:
        self._base = base

    def page(self, token: str) -> bytes:
        """The list, the newest first; token: the instructor's, which its links carry."""
        from ravenjax.document import html  # jinja

        rows = [self._row(one, token) for one in reversed(folders.beside(self._base))]
        template = html.environment("ravenjax.train").get_template("sessions.html.j2")
        return template.render(rows=rows, folder=str(self._base)).encode()

    def debrief(self, path: str) -> bytes | None:
        """The debrief of /sessions/NAME/debrief.html; None where there is none."""
        names = {one.path.name: one.path for one in folders.beside(self._base)}
        for name, folder in names.items():
            if path == _address(name) and (folder / DEBRIEF).is_file():
                return (folder / DEBRIEF).read_bytes()
        return None

    @staticmethod
    def _row(one: SessionFolder, token: str) -> dict[str, Any]:
        blinded = bool(one.header.get("blinded"))
        hazards = one.summary.get("hazards") or {}
        seconds = (one.summary.get("ticks") or 0) / 1000
        address = f"{_address(one.path.name)}?instructor_token={quote(token)}"
        return {
            "name": one.path.name,
            "started": one.started[:16].replace("T", " "),
            "scenario": one.scenario,
            "participant": one.participant,
            "group": "blinded" if blinded else str(one.header.get("group") or ""),
            "seconds": seconds or None,
            "score": hazards.get("score"),
            "reaction_ms": hazards.get("median_reaction_ms"),
            "ended": str(one.summary.get("ended") or "cut short"),
            "address": address if (one.path / DEBRIEF).is_file() else "",
        }


def _address(name: str) -> str:
    return f"/sessions/{quote(name)}/{DEBRIEF}"
