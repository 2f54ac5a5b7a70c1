"""Defines the section [search] of a search file as pydantic models, one for each kind of search."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from ravenjax.analyses.search.file import outcome
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import Section
from ravenjax.campaign.inspection import json_schema
from ravenjax.vocabulary.robot import Robot


def _require_power_of_two(n: int) -> int:
    # A power of two has one set bit.
    if n & (n - 1):
        below = 1 << (n.bit_length() - 1)
        raise ValueError(f"got {n}, expected a power of two, such as {below} or {2 * below}")
    return n


def _require_even(levels: int) -> int:
    if levels % 2:
        raise ValueError(f"got {levels}, expected an even number, such as {levels + 1}")
    return levels


Outcome = Annotated[str, AfterValidator(lambda text: str(outcome.parse_outcome(text)))]
"""A text that `outcome.parse_outcome` can parse."""
Outcomes = Annotated[tuple[Outcome, ...], Field(min_length=1, description="columns or events")]


class Boundary(Section):
    """[search] of kind "boundary": the smallest harmful fault, for each combination of lists."""

    kind: Literal["boundary"]
    """kind of search"""
    harm: Annotated[Outcome, AfterValidator(outcome.require_event)]
    """event, such as 'peak_golden_deviation_mm >= 1'"""
    signs: tuple[Literal[-1, 1], ...] = Field(default=(1,), min_length=1)
    """signs of the fault's value"""
    scan: int = Field(default=17, ge=2, le=10_000)
    """number of values that are tried first, for each combination of lists"""
    tolerance: float = Field(default=0.01, gt=0.0, lt=1.0)
    """accepted width of the result, as a share of its lower end (loguniform) or of the range"""

    @model_validator(mode="after")
    def _require_each_sign_once(self) -> "Boundary":
        if len(set(self.signs)) < len(self.signs):
            raise ValueError(f"signs: got {list(self.signs)}, expected each sign once")
        return self

    @property
    def outcomes(self) -> tuple[str, ...]:
        """The outcomes that are computed for each run."""
        return (self.harm,)


class Sobol(Section):
    """[search] of kind "sobol": which share of an outcome's variance each input causes."""

    kind: Literal["sobol"]
    """kind of search"""
    outcomes: Outcomes
    n: Annotated[int, AfterValidator(_require_power_of_two)] = Field(default=1024, ge=8, le=2**24)
    """size of the base sample, a power of two; d inputs need n (d + 2) runs"""


class Morris(Section):
    """[search] of kind "morris": cheap screening of many inputs, changed one at a time."""

    kind: Literal["morris"]
    """kind of search"""
    outcomes: Outcomes
    trajectories: int = Field(default=100, ge=4, le=1_000_000)
    """number of trajectories; each has d + 1 runs for d inputs"""
    levels: Annotated[int, AfterValidator(_require_even)] = Field(default=8, ge=4, le=1000)
    """number of values of each input, an even number"""


class Rare(Section):
    """[search] of kind "rare": the probability of a rare event, by two estimators."""

    kind: Literal["rare"]
    """kind of search"""
    event: Annotated[Outcome, AfterValidator(outcome.require_margin)]
    """a column and its limit, such as 'peak_model_deviation_mm >= 10'"""
    runs: int = Field(default=2000, ge=100, le=10_000_000)
    """number of runs in each level of the subset simulation"""
    steps: int = Field(default=10, ge=2, le=100)
    """length of a Markov chain; runs / steps runs start the next level"""
    check: int = Field(default=20_000, ge=0, le=100_000_000)
    """number of runs of plain Monte Carlo, for comparison; 0: none"""

    @model_validator(mode="after")
    def _require_equal_chains(self) -> "Rare":
        # A level consists of runs / steps chains of equal length, and at least two.
        if self.runs % self.steps or self.runs // self.steps < 2:
            below = max(2, self.runs // self.steps) * self.steps
            raise ValueError(
                f"runs: got {self.runs}, expected a multiple of steps = {self.steps}, such as"
                f" {below}"
            )
        return self

    @property
    def outcomes(self) -> tuple[str, ...]:
        """The outcomes that are computed for each run."""
        return (self.event,)


Search = Boundary | Sobol | Morris | Rare

KINDS: dict[str, type[Search]] = {
    model.__name__.lower(): model for model in (Boundary, Sobol, Morris, Rare)
}


class SearchTable(Section):
    """The section that a search file has in addition to those of a campaign file."""

    search: Search = Field(
        discriminator="kind",
        description=f"write a section [search] with the key kind, one of {', '.join(KINDS)}",
    )


@dataclasses.dataclass(frozen=True)
class SearchConfig:
    """A whole search file."""

    campaign: CampaignConfig  # campaign with one group, from which runs are made
    search: Search

    @property
    def source(self) -> Path | None:
        """The file from which the search was read; None for a search without a file."""
        return self.campaign.source

    def resolved(self) -> dict[str, Any]:
        """Return the whole content with defaults filled in, as JSON values."""
        return self.campaign.model_dump(mode="json") | {
            "search": self.search.model_dump(mode="json")
        }


def json_schema_of(robot: Robot) -> dict[str, Any]:
    """Return the JSON Schema of a search file: of a campaign with one group and a [search]."""
    schema: dict[str, Any] = {**json_schema.campaign_schema(robot), "title": "ravenjax search"}
    for name, model in KINDS.items():
        section = model.model_json_schema(ref_template="#/$defs/{model}")
        json_schema.tidy_schema(section)
        section["properties"]["kind"] = {"const": name, "description": "kind of search"}
        schema["$defs"][model.__name__] = section
    schema["properties"]["search"] = {
        "description": "[search]: what the search looks for",
        "oneOf": [{"$ref": f"#/$defs/{model.__name__}"} for model in KINDS.values()],
    }
    schema["properties"]["group"]["maxItems"] = 1
    schema["required"] = [*schema["required"], "search"]
    return schema
