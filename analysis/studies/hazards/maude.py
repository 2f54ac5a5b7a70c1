"""Reads shares of adverse event reports by category, and the rows of the library that represent
each, from `data/maude.toml`.

They are shares of reports and not probabilities of a fault. `CAVEAT` belongs beside every number
computed from them.
"""

from __future__ import annotations

import tomllib
from functools import cache

from pydantic import Field, model_validator

from ravenjax.hazards import library
from ravenjax.hazards.library import DATA, Hazard, LibraryTable

FILE = "maude.toml"
CAVEAT = (
    "Weights are shares of adverse event reports (MAUDE 2000 to 2013), not probabilities of a"
    " fault: weighted is how bad the simulated faults of each category are, by how often that"
    " category was reported. Categories overlap; which simulated hazards stand for a category is"
    " ours."
)


class Category(LibraryTable):
    """One category of reports."""

    name: str = Field(min_length=1)
    count: int = Field(ge=1, description="reports")
    share: float = Field(gt=0.0, le=1.0, description="of all reports, as published")
    source: str = Field(min_length=1)
    hazards: tuple[str, ...] = Field(
        default=(), description="rows with one of these hazards stand for it"
    )
    scenarios: tuple[str, ...] = Field(
        default=(), description="rows of one of these training scenarios do"
    )
    ids: tuple[str, ...] = Field(default=(), description="these rows do")

    def covers(self, row: Hazard) -> bool:
        """Return whether a row of the library represents this category."""
        return (
            row.id in self.ids
            or any(h in self.hazards for h in row.hazards)
            or any(scenario in self.scenarios for scenario in row.scenarios)
        )

    @property
    def rows(self) -> tuple[Hazard, ...]:
        """Return the runnable rows that represent it. Without any, the category is not
        simulated.
        """
        return tuple(row for row in library.all_hazards() if row.runnable and self.covers(row))


class Reports(LibraryTable):
    """All categories."""

    reports: int
    source: str
    category: tuple[Category, ...]

    @model_validator(mode="after")
    def _consistent(self) -> Reports:
        for one in self.category:
            if abs(one.count / self.reports - one.share) > 0.001:  # the source gives per mille
                raise ValueError(
                    f"{one.name}: {one.count} of {self.reports} reports is not a share of"
                    f" {one.share}"
                )
        return self


@cache
def reports() -> Reports:
    """Return the categories of `data/maude.toml`."""
    return Reports.model_validate(tomllib.loads((DATA / FILE).read_text(encoding="utf-8")))
