"""Defines a study: the campaigns that repeat a published experiment, and the comparison of their
results with published numbers.

Texts and published numbers are in data files: `studies.toml`, `targets.toml`, and the files with
the study's name in `variants`, `published`, `tables` and `notes`.
"""

import dataclasses
import itertools
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from ravenjax.stats.intervals import Estimate, Rate
from studies import kinds

HERE = Path(__file__).parent
Cell = str | int | float
Tables = Mapping[str, Iterable[Sequence[Cell]]]
"""Rows of tables by their keys in `tables/STUDY.md`."""


@dataclasses.dataclass(frozen=True)
class Variant:
    """One campaign of a study: the baseline, or one change of it."""

    name: str  # also the name of its folder
    campaign: str  # file name of a bundled campaign
    overrides: tuple[str, ...] = ()  # key.path=value, as --set takes them
    question: str = ""  # what this variant changes; "" for the baseline


@dataclasses.dataclass(frozen=True)
class StudyEstimate:
    """A number with its interval, and what it was counted over."""

    value: float
    low: float = math.nan  # NaN: no interval is known
    high: float = math.nan
    n: int = 0  # number of independent units; 0: not a count
    of: str = ""  # what n counts: "runs", "cells", "read off Figure 9, about +-1 count"


@dataclasses.dataclass(frozen=True)
class Line:
    """One published quantity and its prediction."""

    quantity: str  # such as "P(jump), 8 ms"
    unit: str  # such as "", "mm", "%"
    published: StudyEstimate | None
    predicted: StudyEstimate | None
    band: tuple[float, float] | None = None  # acceptance band, ends included
    target: str = ""  # acceptance target, such as "A1"
    reason: str = ""  # likely reason if both differ

    @property
    def passed(self) -> bool | None:
        """Return whether the prediction is in its band; None without band or prediction."""
        if self.band is None or self.predicted is None:
            return None
        return bool(self.band[0] <= self.predicted.value <= self.band[1])


@dataclasses.dataclass(frozen=True)
class Table:
    """Results that have more than one number per quantity."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""  # one paragraph below it


def own_line(quantity: str, unit: str, found: StudyEstimate | None) -> Line:
    """Return a line for a quantity without a published value."""
    return Line(quantity, unit, None, found)


def in_percent(found: Estimate | Rate | StudyEstimate, n: int, of: str) -> StudyEstimate:
    """Convert a fraction with its interval to percent."""
    return StudyEstimate(100 * found.value, 100 * found.low, 100 * found.high, n, of)


def percent_line(quantity: str, found: Rate | StudyEstimate, of: str = "") -> Line:
    """Return the line of a share. `of`: what it was counted over, unless the estimate says it."""
    return own_line(quantity, "%", in_percent(found, found.n, of or getattr(found, "of", "")))


@dataclasses.dataclass(frozen=True)
class Findings:
    """The findings of a study."""

    lines: tuple[Line, ...]
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()  # paragraphs: assumptions, what is not reproduced


class Context(NamedTuple):
    """Input of a study's comparison: one finished result folder per variant."""

    folders: Mapping[str, Path]
    engine: str = "auto"


@dataclasses.dataclass(frozen=True)
class Study:
    """A published experiment, or a question of the project itself."""

    name: str
    title: str
    source: str
    question: str
    variants: tuple[Variant, ...]
    compare: Callable[[Context], Findings]
    targets: tuple[str, ...] = ()  # acceptance targets that the study reports
    minutes: float = 1.0  # approximate duration on two cores


def read_toml(path: str) -> dict[str, Any]:
    """Return the content of a file in this folder."""
    return tomllib.loads((HERE / path).read_text(encoding="utf-8"))


def study(
    name: str, variants: tuple[Variant, ...], compare: Callable[[Context], Findings]
) -> Study:
    """Return the study with a name in studies.toml."""
    about = dict(read_toml("studies.toml")[name])
    about.pop("module", "")
    targets = tuple(about.pop("targets", ()))
    return Study(name, variants=variants, compare=compare, targets=targets, **about)


def plain(value: Any) -> Any:
    """Convert a finding to JSON values: dataclasses become tables, NaN becomes null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return fields | {"passed": value.passed} if isinstance(value, Line) else fields
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_variants(study: str) -> tuple[Variant, ...]:
    """Return the variants of `variants/STUDY.toml`. The first is the baseline.

    With `each`, a row stands for one variant for each combination of these values, and with `rows`
    for one for each of these tables. The values replace `$NAME` in its texts. With `needs`, it is
    left out without the recording of that name, whose path replaces `$file`. With a table
    `recorded_hands`, the variants of that file follow. A campaign may be a file of this folder.
    """
    from studies.dsn16 import recording

    content, variants = read_toml(f"variants/{study}.toml"), []
    rows, hands = list(content["variants"]), content.get("recorded_hands", {})
    if hands:
        for row in read_toml("variants/recorded_hands.toml")["variants"]:
            rows.append(row | {"overrides": [*row["overrides"], *hands["overrides"]]})
    for row in rows:
        file = recording.locate(row["needs"]) if "needs" in row else ""
        if file is None:
            continue
        campaign = row.get("campaign", content["campaign"])
        campaign = str(HERE / campaign) if (HERE / campaign).is_file() else campaign
        each = row.get("each", {})
        drawn = itertools.product(*each.values())
        for values in row.get("rows") or (dict(zip(each, one, strict=True)) for one in drawn):
            words = {"file": file, "prefix": hands.get("prefix", ""), **values}
            name, question, *overrides = (
                Template(text).substitute(words)
                for text in (row["name"], row.get("question", ""), *row.get("overrides", ()))
            )
            if name not in hands.get("leave_out", ()):
                variants.append(Variant(name, campaign, tuple(overrides), question))
    return tuple(variants)


def read_notes(study: str, **values: object) -> tuple[str, ...]:
    """Return the paragraphs of `notes/STUDY.md`, with these values and `kinds.NOTE` for names."""
    text = (HERE / "notes" / f"{study}.md").read_text(encoding="utf-8")
    return tuple(part.format(kinds=kinds.NOTE, **values) for part in text.strip().split("\n\n"))


def read_table(study: str, key: str, rows: Iterable[Sequence[Cell]], **values: object) -> Table:
    """Return the table that `tables/STUDY.md` describes below `## KEY`, with these rows: title,
    columns separated by ` | `, and the note, if any. Names in braces are replaced as in
    `read_notes`. Raises ValueError if a row has another number of cells.
    """
    text = (HERE / "tables" / f"{study}.md").read_text(encoding="utf-8")
    part = next(part for part in text.split("## ") if part.startswith(f"{key}\n"))
    title, columns, *note = (
        paragraph.format(kinds=kinds.NOTE, **values)
        for paragraph in part.partition("\n")[2].strip().split("\n\n")
    )
    heads, cells = tuple(columns.split(" | ")), tuple(map(tuple, rows))
    if any(len(row) != len(heads) for row in cells):
        raise ValueError(f"{study}, table {key}: a row does not have {len(heads)} cells")
    return Table(title, heads, cells, *note)


def findings(
    study: str, lines: Iterable[Line], tables: Tables, notes: Iterable[str] = (), **values: object
) -> Findings:
    """Return findings with the tables of `tables/STUDY.md` (rows by key), and with these notes and
    those of `notes/STUDY.md`. `values` replace names in braces, as in `read_notes`.
    """
    written = tuple(read_table(study, key, rows, **values) for key, rows in tables.items())
    return Findings(tuple(lines), written, (*notes, *read_notes(study, **values)))


class Published:
    """The published numbers and acceptance bands of `published/NAME.toml`, by key. A number read
    off a plot has the reading `error`, or `low` and `high`. Methods raise KeyError.
    """

    def __init__(self, name: str) -> None:
        content = read_toml(f"published/{name}.toml")
        self.numbers = {row["key"]: row for row in content.get("number", ())}
        self.bands = {row["key"]: (row["low"], row["high"]) for row in content.get("band", ())}

    def value(self, key: str) -> float:
        """Return a published number."""
        return self.numbers[key]["value"]

    def estimate(self, key: str) -> StudyEstimate:
        """Return a published number with its interval and source."""
        row = self.numbers[key]
        value, error = row["value"], row.get("error", math.nan)
        low, high = row.get("low", value - error), row.get("high", value + error)
        return StudyEstimate(value, low, high, of=row["source"])

    def band(self, key: str) -> tuple[float, float]:
        """Return the low and high end of a band."""
        return self.bands[key]


# --- acceptance targets ---


class Target(NamedTuple):
    """A published result that is to be reproduced."""

    id: str  # "A1"
    title: str
    source: str
    band: str  # in words
    judged_by: str  # studies, or the command that measures it

    @property
    def definition(self) -> str:
        """Return `A1: share of runs with a jump, ... (DSN 2016, Figure 9 b). Band: ...`."""
        return f"{self.id}: {self.title} ({self.source}). Band: {self.band}."


@cache
def targets() -> dict[str, Target]:
    """Return every target by its id."""
    return {name: Target(name, **row) for name, row in read_toml("targets.toml").items()}


def standings(lines: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the standing of each target in words, `A1 not met: 6 of 9 lines inside their band`. A
    target is met if all its lines with a band are inside.
    """
    found = {}
    for name in dict.fromkeys(line["target"] for line in lines if line["target"]):
        banded = [line for line in lines if line["target"] == name and line["band"] is not None]
        judged = [line["passed"] for line in banded if line["passed"] is not None]
        if judged:
            noun = "line inside its band" if len(judged) == 1 else "lines inside their band"
            met = "met" if all(judged) else "not met"
            found[name] = f"{name} {met}: {sum(judged)} of {len(judged)} {noun}"
        else:
            why = "line with a band has a prediction" if banded else "line has a band"
            found[name] = f"{name} not judged: no {why}"
    return found
