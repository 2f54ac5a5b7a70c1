"""What the numbers of a parameter record may be: unit, range and meaning of each, said once, at its
field.

    scale: Annotated[Scalar, Quantity("", 0, 1, "tip motion per hand motion")]

Records with many numbers are `described` by a TOML file beside their module.

A range keeps out what has no meaning (negative mass, a packet every 0 cycles), what single
precision cannot hold, and what is a slip of the unit (degrees for radians). Within it the robot may
be as bad as a campaign wants it.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import tomllib
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

Record = TypeVar("Record")

HOUR_MS = 3_600_000
"""The longest run, and so the longest time of a parameter."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Annotation of a field: what its number, or each number in it, may be.

    A vector with unlike joints has several, beside each other or in a tuple, each with its
    `joints`. One with joints in a record that stands at a joint's name holds where it is one of
    them.
    """

    unit: str
    low: float
    high: float
    meaning: str
    whole: bool = False
    joints: tuple[str, ...] = ()  # joints that it is of; (): every number of the field
    why: str = ""  # what the range keeps out, where the meaning does not say it
    # key of [campaign] and the value with which something reads it; None: always
    read_when: tuple[str, str] | None = None

    @property
    def range(self) -> str:
        """`1..1000 cycles, whole`"""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:.10g}..{self.high:.10g}{unit}" + (", whole" if self.whole else "")

    def __str__(self) -> str:
        return f"{self.range} ({self.why or self.meaning})"


@dataclasses.dataclass(frozen=True)
class Reserved:
    """Annotation of a field that a campaign must leave alone, with all that is in it.

    What is said of a part of it goes first.
    """

    why: str  # and what to write instead


def described(record: type[Record]) -> type[Record]:
    """Annotate a record's fields with what the table of its name in quantities.toml says, which
    lies beside its module.
    """
    path = Path(str(sys.modules[record.__module__].__file__)).with_name("quantities.toml")
    for name, rows in _tables(path)[record.__name__].items():
        notes = tuple(map(_note, rows if isinstance(rows, list) else [rows]))
        record.__annotations__[name] = Annotated[record.__annotations__[name], notes]
    return record


@functools.cache
def _tables(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _note(row: dict[str, Any]) -> Quantity | Reserved:
    if "reserved" in row:
        return Reserved(row["reserved"])
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}
    return Quantity(**values)


def quantities(params: type) -> Iterator[tuple[str, Quantity]]:
    """(path, what it may be) of every number of a record class, in order; more than once where
    joints are unlike.

    A path has no arm, number of a set, joint or axis: it is that of the fields.
    """
    for path, notes in _fields(params):
        limits = [one for one in notes if isinstance(one, Quantity)]
        here = {*path.split(".")} & {joint for one in limits for joint in one.joints}
        for one in limits:
            if not here:
                yield path, one
            elif here & {*one.joints}:
                yield path, dataclasses.replace(one, joints=())


def reserved(params: type) -> Iterator[tuple[str, str]]:
    """(path, why) of every field of a record class that a campaign must leave alone."""
    for path, notes in _fields(params):
        yield from ((path, one.why) for one in notes if isinstance(one, Reserved))


def _fields(params: type, above: str = "") -> Iterator[tuple[str, list[Any]]]:
    """(path, what its annotation says) of each field of a record class, and of the records in
    it.
    """
    hints = typing.get_type_hints(params, include_extras=True)
    for field in dataclasses.fields(params):
        inner, notes = _opened(hints[field.name])
        path = f"{above}{field.name}"
        yield path, notes
        if isinstance(inner, type) and dataclasses.is_dataclass(inner):
            yield from _fields(inner, f"{path}.")


def _opened(hint: Any) -> tuple[Any, list[Any]]:
    """What a field holds one of, and what its annotation says: `Annotated[tuple[X, ...] | None,
    said]`.
    """
    notes: list[Any] = []
    while True:
        kind, parts = typing.get_origin(hint), typing.get_args(hint)
        if kind is typing.Annotated:
            hint = parts[0]
            for one in parts[1:]:
                notes += one if isinstance(one, tuple) else (one,)
        elif kind is tuple:
            hint = parts[0]
        elif kind in (typing.Union, types.UnionType):
            hint = next(part for part in parts if part is not type(None))
        else:
            return hint, notes
