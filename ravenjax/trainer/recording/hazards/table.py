"""hazards.csv read back: one row for each hazard of a session; its columns are described in `judge.episode`."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

from ravenjax.errors import StoreError

FILE = "hazards.csv"
NUMBERS = (
    *("armed_ms", "struck_ms", "knowable_ms", "cue_ms", "alarm_ms", "limited_ms", "response_ms", "reaction_ms"),
    *("limit_mm", "unintended_mm", "unintended_first_ms", "unintended_off_mm", "loss_mm", "loss_first_ms"),
    *("halted_ms", "golden_halted_ms", "false_report_mm", "false_report_first_ms"),
    *("peak_error_mm", "deepest_mm", "score"),
)
"""Columns of numbers, each of which may be empty."""
OUTCOMES = {
    "avoided": "no harm was done",
    "harm": "harm was done",
    "halted": "the robot halted by itself",
    "unaffected": "the instrument was hardly affected",
    "missed": "it passed without the right response",
}
"""How a hazard may end, in words."""

_FORMER = {"peak_stray_mm", "twin_halted_ms"}
"""Columns that only earlier versions wrote."""


@dataclasses.dataclass(frozen=True)
class HazardRow:
    """One row. Times are ms since the session began, None where it never happened; sizes None where not measured."""

    session: str
    participant: str
    group: str
    scenario: str
    seed: str
    cue: str  # on, off
    number: int
    hazard: str  # id in the library
    title: str
    arm: str
    armed_ms: float | None
    struck_ms: float | None
    knowable_ms: float | None
    knowable_by: str
    cue_ms: float | None
    alarm_ms: float | None  # first check that told a person or stopped the robot
    alarm: str
    limited_ms: float | None  # first check that changed a command or dropped a packet: nobody was told
    limited: str
    check_response: str  # one of outcomes.verdict.RESPONSES; "" where it never struck
    check_cause: str  # first check that did so
    motion_hazard: str  # one of outcomes.verdict.HAZARDS
    limit_mm: float | None  # of hazards and harm: the scenario's
    unintended_mm: float | None
    unintended_first_ms: float | None
    unintended_off_mm: float | None
    loss_mm: float | None
    loss_first_ms: float | None
    halted_ms: float | None
    golden_halted_ms: float | None
    false_report_mm: float | None
    false_report_first_ms: float | None
    peak_error_mm: float | None  # of the reported tip from the model, which the cue acts on
    deepest_mm: float | None
    response: str  # the operator's
    response_ms: float | None
    reaction_ms: float | None
    right_response: str
    response_ok: bool
    halted: bool  # the robot left pedal-down by itself
    outcome: str
    score: float | None
    blinded: bool = False

    @property
    def after(self) -> dict[str, float]:
        """ms after the strike of whatever happened: knowable, cue, alarm, response."""
        if self.struck_ms is None:
            return {}
        times = {"knowable": self.knowable_ms, "cue": self.cue_ms, "alarm": self.alarm_ms, "response": self.response_ms}
        return {name: time - self.struck_ms for name, time in times.items() if time is not None}

    @property
    def farthest_mm(self) -> float | None:
        """Largest unintended motion of the true tip, while the robot was live and while it was not."""
        return max((mm for mm in (self.unintended_mm, self.unintended_off_mm) if mm is not None), default=None)


def read(folder: Path) -> list[HazardRow]:
    """Hazards of a session's folder in the order of their strike; none where it has no hazards.csv.

    Raises StoreError where the file is damaged or lacks a column.
    """
    path = Path(folder) / FILE
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            columns = list(reader.fieldnames or [])
            lines = list(reader)
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StoreError(f"{path}: cannot be read ({error})") from error
    wanted = [one.name for one in dataclasses.fields(HazardRow)]
    if former := _FORMER.intersection(columns):
        raise StoreError(
            f"{path}: was written by an earlier version of ravenjax, which named or defined outcomes differently (it "
            f"has the column {min(former)}). The file is fine: read it with the version that session.json names"
        )
    if missing := [name for name in wanted if name not in columns]:
        raise StoreError(f"{path}: has no column {', '.join(missing)}; expected those that `ravenjax train` writes")
    rows = [_hazard(path, i + 2, {name: line[name] or "" for name in wanted}) for i, line in enumerate(lines)]
    return sorted(rows, key=lambda one: (one.struck_ms is None, one.struck_ms or 0.0, one.number))


def _hazard(path: Path, line: int, cells: dict[str, str]) -> HazardRow:
    values: dict[str, object] = dict(cells)
    for name in NUMBERS:
        values[name] = _number(path, line, name, cells[name])
    for name in ("response_ok", "halted", "blinded"):
        values[name] = cells[name].strip().lower() in ("true", "1", "yes")
    number = _number(path, line, "number", cells["number"])
    if number is None:
        raise StoreError(f"{path}: line {line}: number is empty, expected the hazard's number in session.json")
    values["number"] = int(number)
    return HazardRow(**values)  # type: ignore[arg-type]


def _number(path: Path, line: int, name: str, text: str) -> float | None:
    try:
        value = float(text) if text.strip() else None
    except ValueError:
        raise StoreError(f"{path}: line {line}: {name} is {text!r}, expected a number or nothing") from None
    return value if value is None or abs(value) < float("inf") else None
