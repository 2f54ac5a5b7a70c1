"""What made the findings: engine, versions, code, each campaign with its hash; nothing of the
place or the time.
"""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import PurePath
from typing import Any


@dataclasses.dataclass(frozen=True)
class CampaignRecord:
    """One campaign of a study as it was run."""

    variant: str
    campaign: str  # file name of a bundled campaign
    overrides: tuple[str, ...]
    question: str
    runs: int
    seconds: float  # s, length of each run
    seed: int
    config_hash: str

    @property
    def command(self) -> str:
        """That runs it alone."""
        words = [
            "ravenjax",
            "run",
            self.campaign,
            *(word for text in self.overrides for word in ("--set", text)),
        ]
        return shlex.join(words)


@dataclasses.dataclass(frozen=True)
class Provenance:
    """Everything that decides a study's findings."""

    engine: str
    device: str
    code_hash: str
    lock_hash: str
    versions: dict[str, str]
    campaigns: tuple[CampaignRecord, ...]

    def as_json(self) -> dict[str, Any]:
        """As JSON can hold it."""
        plain = dataclasses.asdict(self)
        for row, campaign in zip(plain["campaigns"], self.campaigns, strict=True):
            row["command"] = campaign.command
        return plain


def shown_override(text: str) -> str:
    """An override without the folders of this machine: an absolute path becomes the file's name."""
    key, equals, value = text.partition("=")
    bare = value.strip("\"'")
    return f"{key}{equals}{PurePath(bare).name}" if bare.startswith(("/", "~")) else text
