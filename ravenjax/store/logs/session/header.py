"""What readers take from a session.json, and of which type each key is; the file holds more keys
than these.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class HeaderTable(BaseModel):
    """A table of session.json: numbers are numbers; a session that was killed may lack any key."""

    model_config = ConfigDict(strict=True)


class ListedHazard(HeaderTable):
    """An entry of `hazards`."""

    number: int = 0
    within_s: float = 0.0


class HarmLimits(HeaderTable):
    """`scenario.harm`: from which on a motion counts as harm, mm."""

    excursion_mm: float | None = None
    depth_mm: float | None = None


class ScenarioOfSession(HeaderTable):
    """`scenario`, as it was when the session began."""

    name: str | None = None
    title: str | None = None
    harm: HarmLimits | None = None


class SessionHeader(HeaderTable):
    """The whole file."""

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
