"""[controller]: files of one's own in place of stages of the control software."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pydantic import Field, model_validator

from ravenjax.campaign.file import own_part
from ravenjax.campaign.file.section import Section
from ravenjax.parts import part
from ravenjax.robots.raven2.loop.replaced import STAGES
from ravenjax.vocabulary.parts import OwnSource


class OwnStages(Section):
    """[controller]: a Python file of your own in place of a stage; its parameters are
    control.own.STAGE...
    """

    motor_control: Path | None = Field(
        default=None,
        description=(
            "a file whose step gives (state, tau_d): desired torques from desired motor positions"
        ),
    )
    dac: Path | None = Field(
        default=None,
        description="a file whose step gives (state, current_cmd): DAC counts from desired torques",
    )
    sha256: dict[str, str] = Field(
        default_factory=dict,
        description=f"stage = of that file {own_part.CONTENT}",
    )

    @model_validator(mode="after")
    def _some(self) -> OwnStages:
        if not list(self.files()):
            raise ValueError(
                f'replaces nothing: write {" or ".join(STAGES)} = "file.py", or remove the section'
            )
        if strays := [stage for stage in self.sha256 if stage not in dict(self.files())]:
            raise ValueError(f"sha256 has {strays[0]!r}, which is not replaced: remove it")
        return self

    def files(self) -> Iterator[tuple[str, Path]]:
        """(stage, file) of those that are replaced, in the order of the tick."""
        for stage in STAGES:
            if (file := getattr(self, stage)) is not None:
                yield stage, file

    def parts(self) -> Iterator[tuple[str, OwnSource]]:
        """(stage, code). Raises UserError for a file that is unusable or changed."""
        for stage, file in self.files():
            yield stage, own_part.source(stage, file, self.sha256.get(stage), "stage")

    def located(self, folder: Path) -> OwnStages:
        """Itself, its files taken from `folder` and known by their content."""
        there = self.model_copy(
            update={stage: folder.absolute() / file for stage, file in self.files()}
        )
        return there.model_copy(
            update={"sha256": {stage: part.digest(source) for stage, source in there.parts()}}
        )
