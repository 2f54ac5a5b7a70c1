"""Published numbers as data: `published/NAME.toml`, each with the place that it was read from.

A number that stands in print has `source`; one that was read off a plot also has the reading
`error`, or `low` and `high`. A band is what counts as agreement; `source` says who set it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ravenjax.errors import UserError, suggestion
from studies.framework import toml_record
from studies.framework.study import StudyEstimate

FOLDER = Path(__file__).parent / "published"


class _Row(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    key: str = Field(
        pattern=r"^[a-z0-9_.-]+$", description="name under which the studies look it up"
    )
    unit: str = Field(description='as printed beside the number, "" for none')
    source: str = Field(min_length=1, description="where it was read")


_R = TypeVar("_R", bound=_Row)


class Number(_Row):
    """One published number."""

    value: float
    error: float | None = Field(default=None, gt=0.0, description="reading error, plus or minus")
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _one_interval(self) -> Number:
        if (self.low is None) != (self.high is None):
            raise ValueError("give both low and high, or neither")
        if self.low is not None and self.high is not None:
            if self.error is not None:
                raise ValueError("give either error, or low and high")
            if not self.low <= self.value <= self.high:
                raise ValueError(
                    f"expected low <= value <= high, got {self.low}, {self.value}, {self.high}"
                )
        return self

    def estimate(self) -> StudyEstimate:
        """With the interval that its reading has."""
        low, high = (
            (math.nan, math.nan) if self.low is None or self.high is None else (self.low, self.high)
        )
        if self.error is not None:
            low, high = self.value - self.error, self.value + self.error
        return StudyEstimate(self.value, low, high, of=self.source)


class Band(_Row):
    """What counts as agreement, ends included."""

    low: float
    high: float

    @model_validator(mode="after")
    def _ordered(self) -> Band:
        if self.low > self.high:
            raise ValueError(f"expected low <= high, got {self.low}, {self.high}")
        return self


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    number: tuple[Number, ...] = ()
    band: tuple[Band, ...] = ()

    @model_validator(mode="after")
    def _distinct(self) -> _File:
        for rows in (self.number, self.band):
            keys = [row.key for row in rows]
            if twice := sorted({key for key in keys if keys.count(key) > 1}):
                raise ValueError(f"keys that stand twice: {', '.join(twice)}")
        return self


@dataclass(frozen=True)
class Published:
    """The numbers and bands of one file, by key."""

    numbers: Mapping[str, Number]
    bands: Mapping[str, Band]

    def value(self, key: str) -> float:
        """A published number. KeyError where there is none of that key."""
        return _at(self.numbers, key).value

    def estimate(self, key: str) -> StudyEstimate:
        """A published number with its interval and source. KeyError where there is none of that
        key.
        """
        return _at(self.numbers, key).estimate()

    def band(self, key: str) -> tuple[float, float]:
        """Low and high end. KeyError where there is none of that key."""
        band = _at(self.bands, key)
        return band.low, band.high


def read(name: str) -> Published:
    """The numbers of `published/NAME.toml`. Raises UserError for a file that is missing or not
    as described above.
    """
    path = FOLDER / f"{name}.toml"
    if not path.is_file():
        names = sorted(file.stem for file in FOLDER.glob("*.toml"))
        raise UserError(f"{path}: no such file; published numbers are there of {', '.join(names)}")
    return parse(path.read_text(encoding="utf-8"), str(path))


def parse(text: str, where: str) -> Published:
    """As `read`, of a file's text; `where` names it in errors."""
    content = toml_record.read(_File, text, where)
    return Published(
        {row.key: row for row in content.number}, {row.key: row for row in content.band}
    )


def _at(rows: Mapping[str, _R], key: str) -> _R:
    if key not in rows:
        raise KeyError(f"no published number or band is named {key!r}{suggestion(key, rows)}")
    return rows[key]
