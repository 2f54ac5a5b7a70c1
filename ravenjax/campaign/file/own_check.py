"""[[check]]: a check of one's own that stands in the loop."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from ravenjax.campaign.file import own_part
from ravenjax.campaign.file.section import Section
from ravenjax.parts import part
from ravenjax.vocabulary.checks import DOES, Action, Check, CheckUse, of_own
from ravenjax.vocabulary.parts import OwnSource


class OwnCheck(Section):
    """[[check]]: a check of your own at a seam of the tick; it acts in the same millisecond."""

    name: str = Field(
        description="what it is called in tables, where its columns are check_own_NAME_..",
        max_length=60,
    )
    file: Path = Field(description="a Python file with the check, from this file's folder")
    sha256: str | None = Field(
        default=None,
        pattern=own_part.SHA256,
        description=f"of that file {own_part.CONTENT}",
    )
    at: str = Field(description="seam where it stands")
    acts: Action = Field(
        default="watch",
        description="what it does when it trips, by the robot's own means; "
        + "; ".join(f"{word}: {meaning}" for word, meaning in DOES.items()),
    )
    threshold: float = Field(
        default=1.0,
        ge=0.0,
        le=1e6,
        description="it trips above it; varied as checks.threshold.NAME",
    )
    consecutive: int = Field(
        default=1,
        ge=1,
        le=8,
        description="milliseconds in a row above the threshold in which it trips from then on",
    )

    @model_validator(mode="after")
    def _named(self) -> OwnCheck:
        if not own_part.IDENTIFIER.fullmatch(self.name):
            raise ValueError(
                f"name = {self.name!r}, expected letters, digits and _, a letter first: parameters"
                " of its file are called checks.own.NAME"
            )
        return self

    @property
    def part(self) -> OwnSource:
        """The code of its file. Raises UserError for one that is unusable or changed."""
        return own_part.source(self.name, self.file, self.sha256, "check")

    @property
    def use(self) -> CheckUse:
        """Itself, as the tick has it. Raises UserError as `part`."""
        return CheckUse(self.name, self.part, self.at, self.acts, self.consecutive)

    @property
    def check(self) -> Check:
        """Itself, as tables have it."""
        return of_own(self.name, self.at, self.acts)

    def located(self, folder: Path) -> OwnCheck:
        """Itself, its file taken from `folder` and known by its content."""
        there = self.model_copy(update={"file": folder.absolute() / self.file})
        return there.model_copy(update={"sha256": part.digest(there.part)})
