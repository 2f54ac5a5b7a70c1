"""What a study is: a published experiment as campaigns, and its findings beside what was published.

A study is a module of this package with one name `STUDY`; `catalogue` lists them. What was
published is data in `published/*.toml`, each number with its source. A finding never says "right"
or "wrong": it holds both numbers, both intervals, the acceptance band where there is one, and,
where the two differ, the likely reason.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True)
class Variant:
    """One campaign of a study: the baseline, or that with one open question of the papers
    answered otherwise.
    """

    name: str  # also its folder
    campaign: str  # file name of a bundled campaign
    overrides: tuple[str, ...] = ()  # key.path=value, as --set takes them
    question: str = (
        ""  # what the source leaves open and this variant answers otherwise; "" for the baseline
    )


@dataclasses.dataclass(frozen=True)
class StudyEstimate:
    """A number with its interval, and what it was counted over."""

    value: float
    low: float = math.nan  # NaN: no interval is known
    high: float = math.nan
    n: int = 0  # independent units behind it; 0: not a count
    of: str = ""  # what n counts: "runs", "cells", "events", "read off Figure 9, about +-1 count"


@dataclasses.dataclass(frozen=True)
class Line:
    """One published quantity beside the prediction."""

    quantity: str  # "P(jump), 8 ms"
    unit: str  # "", "mm", "%", ...
    published: StudyEstimate | None
    predicted: StudyEstimate | None
    band: tuple[float, float] | None = (
        None  # acceptance band of the prediction's value, ends included
    )
    target: str = ""  # acceptance target, "A1"
    reason: str = ""  # likely reason where both differ

    @property
    def passed(self) -> bool | None:
        """Whether the prediction is in its band; None without band or prediction."""
        if self.band is None or self.predicted is None:
            return None
        return bool(self.band[0] <= self.predicted.value <= self.band[1])


@dataclasses.dataclass(frozen=True)
class Table:
    """Anything that is more than one number a quantity: sensitivity to open semantics, outcome
    classes, events.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | int | float, ...], ...]
    note: str = ""  # one paragraph below it


@dataclasses.dataclass(frozen=True)
class Drawing:
    """A figure, drawn when it is written."""

    name: str  # file name without ending
    caption: str
    draw: Callable[[Any], None]  # draws on an empty matplotlib Figure


@dataclasses.dataclass(frozen=True)
class Findings:
    """What a study found."""

    lines: tuple[Line, ...]
    tables: tuple[Table, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    notes: tuple[
        str, ...
    ] = ()  # paragraphs: assumptions, what is not reproduced, what disagrees and likely why


@dataclasses.dataclass(frozen=True)
class Context:
    """What a study's comparison gets: one finished result folder a variant."""

    folders: Mapping[str, Path]
    engine: str = "auto"


@dataclasses.dataclass(frozen=True)
class Study:
    """A published experiment."""

    name: str
    title: str
    source: str
    question: str
    variants: tuple[Variant, ...]
    compare: Callable[[Context], Findings]
    targets: tuple[str, ...] = ()  # acceptance targets that it prints
    minutes: float = 1.0  # on two cores, roughly


def plain(value: Any) -> Any:
    """A finding as JSON can hold it: dataclasses as tables without their drawings, NaN as null."""
    if isinstance(value, Findings):
        return {name: plain(getattr(value, name)) for name in ("lines", "tables", "notes")}
    if isinstance(value, Line):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)} | {
            "passed": value.passed
        }
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
