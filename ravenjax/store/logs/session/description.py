"""Reads and writes session.json, the description of a training session.

The file lies beside session.mcap and hazards.csv. It is replaced atomically, so that a reader never
sees an incomplete file. "ended" is null until the session is over.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ravenjax.errors import StoreError, format_value
from ravenjax.store.files import read_json, require_writable, write_text

FILE = "session.json"
VERSION = 1


class HeaderTable(BaseModel):
    """Base of session.json's tables. A killed session may lack any key."""

    model_config = ConfigDict(strict=True)


class ListedHazard(HeaderTable):
    """An entry of `hazards`."""

    number: int = 0
    within_s: float = 0.0


class HarmLimits(HeaderTable):
    """`scenario.harm`: motions from which on there is harm, mm."""

    excursion_mm: float | None = None
    depth_mm: float | None = None


class ScenarioOfSession(HeaderTable):
    """`scenario`, as it was when the session began."""

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
    # Checksums of the files beside it, taken when the session ended.
    sha256: dict[str, str] | None = None


def write_session(folder: Path, header: Mapping[str, Any]) -> None:
    """Write session.json, in a new folder if needed. Raises StoreError if the disk refuses."""
    require_writable(folder)
    content = {"version": VERSION, **header}
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(folder / FILE, text)


def read_session(folder: Path) -> dict[str, Any]:
    """Return the session description of a folder.

    Raises StoreError if the folder holds no description, or one that is damaged or newer than this
    reader.
    """
    path = Path(folder) / FILE
    missing = (
        f"{folder}: is not the folder of a session, it holds no {FILE}. Give a folder that"
        " `ravenjax train` wrote."
    )
    header = read_json(path, missing, "; the recording beside it holds a copy")
    try:
        SessionHeader.model_validate(header)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "the file"
        expected = first["msg"].removeprefix("Input should be ")
        raise StoreError(
            f"{path}: {key}: got {format_value(first['input'])}, expected {expected}; the"
            " recording beside it holds a copy"
        ) from None
    return header


def update_session(folder: Path, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change some keys of the folder's session.json, tables key by key; return the whole
    description.

    Only one process may write at a time.
    """
    header = _merged(read_session(folder), changes)
    write_session(folder, header)
    return header


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(old)
    for key, value in new.items():
        mine = out.get(key)
        out[key] = (
            _merged(mine, value) if isinstance(mine, dict) and isinstance(value, Mapping) else value
        )
    return out
