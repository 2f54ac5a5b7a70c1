"""Describes the parameters of a robot: unit, range and meaning of each field of a record.

    scale: Annotated[Scalar, Quantity("", 0, 1, "tip motion per hand motion")]

For records with many numbers, `describe_fields` reads these from a TOML file beside the module.

A range excludes values without meaning (negative mass, a packet every 0 cycles), values that single
precision cannot represent, and wrong units (degrees for radians). Within its range a parameter may
describe even a very bad robot.
"""

import dataclasses
import functools
import sys
import typing
from collections.abc import Iterator
from typing import Annotated, Any, TypeVar

from ravenjax import resources

Record = TypeVar("Record")
_read_tables = functools.cache(resources.read_tables)


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Annotation of a field: the values that its number, or each of its numbers, may have. If
    joints have different ranges, the field has several annotations, each with its `joints`. In a
    record with one entry per joint, such an annotation applies to the entries of these joints.
    """

    unit: str
    low: float
    high: float
    meaning: str
    whole: bool = False
    joints: tuple[str, ...] = ()  # joints to which the range applies; (): all numbers of the field
    why: str = ""  # reason for the range, if the meaning does not include it
    # Key of [campaign] and the value with which the number has an effect; None: no condition.
    read_when: tuple[str, str] | None = None

    @property
    def range(self) -> str:
        """The range as text, such as `1..1000 cycles, whole`."""
        unit = f" {self.unit}" if self.unit else ""
        suffix = ", whole" if self.whole else ""
        return f"{self.low:.10g}..{self.high:.10g}{unit}{suffix}"

    def __str__(self) -> str:
        return f"{self.range} ({self.why or self.meaning})"


@dataclasses.dataclass(frozen=True)
class Reserved:
    """Annotation of a field that a campaign must not set, unless an inner field has a Quantity."""

    why: str  # the reason, and what to write instead


def describe_fields(record: type[Record]) -> type[Record]:
    """Class decorator: annotate the fields of a record class, as its table in the file
    quantities.toml describes. The file is in the folder of the class's module.
    """
    tables = _read_tables(str(sys.modules[record.__module__].__file__), "quantities.toml")
    for name, rows in tables[record.__name__].items():
        notes = tuple(map(_note, rows if isinstance(rows, list) else [rows]))
        record.__annotations__[name] = Annotated[record.__annotations__[name], notes]
    return record


def _note(row: dict[str, Any]) -> Quantity | Reserved:
    if "reserved" in row:
        return Reserved(row["reserved"])
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}
    return Quantity(**values)


def list_quantities(params: type) -> Iterator[tuple[str, Quantity]]:
    """Yield (path, Quantity) for every number of a record class, in order. A path consists of names
    of fields only: the vector stops.lower has one path, without joints. It occurs several times,
    because its joints have different ranges.
    """
    for path, notes in _fields(params):
        quantities = [note for note in notes if isinstance(note, Quantity)]
        # In a record with a field for each joint, the path names a joint, such as
        # detectors.shoulder.jpos, and only the range of this joint applies.
        all_joints = {joint for quantity in quantities for joint in quantity.joints}
        joints_in_path = all_joints.intersection(path.split("."))
        for quantity in quantities:
            if not joints_in_path:
                yield path, quantity
            elif joints_in_path.intersection(quantity.joints):
                yield path, dataclasses.replace(quantity, joints=())


def list_reserved(params: type) -> Iterator[tuple[str, str]]:
    """Yield (path, reason) for every field of a record class that a campaign must not set."""
    for path, notes in _fields(params):
        for note in notes:
            if isinstance(note, Reserved):
                yield path, note.why


def _fields(params: type, above: str = "") -> Iterator[tuple[str, list[Any]]]:
    # Yields the dotted path and the annotations of each field, also of fields of nested records.
    hints = typing.get_type_hints(params, include_extras=True)
    for field in dataclasses.fields(params):
        inner, notes = _unwrap_type(hints[field.name])
        # above: "" or the path of `params` with a dot at its end.
        path = f"{above}{field.name}"
        yield path, notes
        if isinstance(inner, type) and dataclasses.is_dataclass(inner):
            yield from _fields(inner, f"{path}.")


def _unwrap_type(hint) -> tuple[Any, list[Any]]:
    """Remove Annotated and tuple from a type, and return the inner type and the annotations. For
    example, `Annotated[tuple[Vec, ...], note]` gives `Vec` and `[note]`.
    """
    notes = []
    while True:
        kind, parts = typing.get_origin(hint), typing.get_args(hint)
        if kind is typing.Annotated:
            hint = parts[0]
            # `describe_fields` annotates with a tuple, other code with a single annotation.
            for note in parts[1:]:
                notes += note if isinstance(note, tuple) else (note,)
        elif kind is tuple:
            hint = parts[0]
        else:
            return hint, notes
