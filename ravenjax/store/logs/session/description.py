"""Reads and writes session.json, the description of a training session.

The file lies beside session.mcap and hazards.csv. It is replaced atomically, so that a reader never
sees an incomplete file. "ended" is null until the session is over.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ravenjax.errors import StoreError, find_mistakes
from ravenjax.store.files import read_json, require_writable, write_text

FILE = "session.json"
VERSION = 1


class HeaderTable(BaseModel):
    """Base class of the tables of session.json. If a session was killed, any key may be missing."""

    model_config = ConfigDict(strict=True)


class ListedHazard(HeaderTable):
    """An entry of the list `hazards`: a hazard of the session."""

    number: int = 0
    within_s: float = 0.0


class HarmLimits(HeaderTable):
    """The table `scenario.harm`: motions above which there is harm, mm."""

    excursion_mm: float | None = None
    depth_mm: float | None = None


class ScenarioOfSession(HeaderTable):
    """The table `scenario`: the scenario at the beginning of the session."""

    name: str | None = None
    title: str | None = None
    harm: HarmLimits | None = None


class SessionHeader(HeaderTable):
    """The whole content of session.json."""

    version: int = Field(le=VERSION)
    name: str | None = None
    scenario: ScenarioOfSession | str | None = None
    participant: str | None = None
    group: str | None = None
    cue: bool | None = None
    blinded: bool | None = None
    cue_threshold_mm: float | None = None
    versions: dict[str, Any] | None = None
    arms: list[str] = []
    robot: str = ""
    started: str | None = None
    ended: str | None = None
    hazards: list[ListedHazard] | None = None
    task: dict[str, Any] | None = None
    summary: dict[str, Any] | None = None
    # Checksums of the other files of the session, computed at its end.
    sha256: dict[str, str] | None = None


def write_session(folder: Path, header: Mapping[str, Any]) -> None:
    """Write session.json, and create its folder if needed. Raise StoreError if that fails."""
    require_writable(folder)
    content = {"version": VERSION, **header}
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(folder / FILE, text)


def read_session(folder: Path) -> dict[str, Any]:
    """Return the content of session.json in a folder. Raise StoreError if the file is missing,
    damaged, or of a newer version.
    """
    path = Path(folder) / FILE
    missing = (
        f"{folder}: is not the folder of a session, because it has no {FILE}. Name a folder that"
        " `ravenjax train` wrote."
    )
    header = read_json(path, missing, "; session.mcap contains a copy")
    try:
        SessionHeader.model_validate(header)
    except ValidationError as error:
        key, problem = next(find_mistakes(error, SessionHeader, header))
        key_path = ".".join(map(str, key)) or "the file"
        raise StoreError(f"{path}: {key_path}: {problem}; session.mcap contains a copy") from None
    return header


def update_session(folder: Path, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change some keys of session.json, also inside tables. Return the new content. Only one
    process may write at a time.
    """
    header = _merged(read_session(folder), changes)
    write_session(folder, header)
    return header


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    # Returns nested tables `old`, in which values of `new` replace or extend those of `old`.
    merged = dict(old)
    for key, value in new.items():
        earlier = merged.get(key)
        if isinstance(earlier, dict) and isinstance(value, Mapping):
            value = _merged(earlier, value)
        merged[key] = value
    return merged
