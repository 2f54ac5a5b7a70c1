"""Reads a recording in a table: Parquet or CSV. The package's docstring lists the columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError, suggestion
from ravenjax.store.logs.topics import ARM_TOPICS
from ravenjax.store.motion import capture_file, packet_file, stamps
from ravenjax.store.motion.track import LENGTHS, ArmTrack, Track, unit_quaternions

ANGLES = {"rad": 1e3, "mrad": 1.0, "deg": 1e3 * math.pi / 180.0}
"""Factors to mrad."""

ARMS = tuple(ARM_TOPICS)
PEDAL = "surgeon_mode"


def read_track(path: Path, arms: tuple[str, ...], rate_hz: float | None) -> Track:
    """The recording of `arms` in a table. UserError names file, row and column of what is wrong
    with it.
    """
    columns = _parquet(path, rate_hz) if path.suffix.lower() == ".parquet" else _csv(path)
    picked = _Columns(path, columns)
    tracks = {
        arm: (picked.position(arm), picked.quat(arm), picked.one(f"{arm}_grasp", ANGLES))
        for arm in arms
    }
    pedal = picked.plain(PEDAL)
    if pedal is not None and (bad := np.flatnonzero((pedal != 0.0) & (pedal != 1.0))).size:
        raise UserError(
            f"{path}: row {bad[0]}, column {PEDAL}: got {pedal[bad[0]]:g}, expected 1 (pedal down)"
            " or 0"
        )
    rows = len(next(iter(columns.values())))
    if rows < 2:
        raise UserError(f"{path}: holds {rows} rows; expected a motion of at least 2")
    time_s, clock, notes = stamps.of_columns(path, picked.times(arms), rows, rate_hz)
    if clock.startswith("column "):
        picked.used.append(clock.removeprefix("column "))
    return Track(
        path=path,
        clock=clock,
        arms={
            arm: ArmTrack(time_s, place, turn, None if jaws is None else np.asarray(jaws))
            for arm, (place, turn, jaws) in tracks.items()
        },
        surgeon_mode=pedal,
        read=tuple(name for name in columns if name in picked.used),
        ignored=tuple(name for name in columns if name not in picked.used),
        notes=(*notes, *picked.notes),
    )


def holds_packets(path: Path) -> bool:
    """Whether a file is a table of a console's packets, or a capture; UserError where it cannot
    be read.
    """
    suffix = path.suffix.lower()
    return suffix in capture_file.SUFFIXES or (
        suffix == ".parquet" and packet_file.holds_packets(_schema(path).names)
    )


def arms_in(path: Path) -> tuple[str, ...]:
    """The arms that a table has positions of, by the names of its columns; UserError where it
    cannot be read.
    """
    if holds_packets(path):
        return ARMS
    names = _schema(path).names if path.suffix.lower() == ".parquet" else list(_csv(path))
    return tuple(arm for arm in ARMS if any(str(name).startswith(f"{arm}_x_") for name in names))


def _schema(path: Path) -> Any:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_schema(path)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> UserError:
    what = str(error).splitlines()[0]
    return UserError(
        f"{path}: not a complete Parquet file, perhaps truncated: {what}. Copy or record it again"
    )


def _parquet(path: Path, rate_hz: float | None) -> dict[str, np.ndarray]:
    """Every column by name; of what nobody looks at the name alone, with zeros of an unsuitable
    type.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = _schema(path)
    names = schema.names
    wanted = [
        name for name in names if name == PEDAL or name.startswith(tuple(f"{arm}_" for arm in ARMS))
    ]
    times = stamps.time_columns(names)
    numeric = [f.name for f in schema if pa.types.is_temporal(f.type) or _is_number(f.type)]
    wanted += times or [name for name in names if name in numeric or stamps.looks_like_time(name)]
    try:
        table = pq.read_table(path, columns=list(dict.fromkeys(wanted)) or names[:1])
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise _damaged(path, error) from None
    values = {name: table[name].to_numpy() for name in table.column_names}
    return {name: values.get(name, np.zeros(len(table), object)) for name in names}


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    return pa.types.is_integer(kind) or pa.types.is_floating(kind)


def _csv(path: Path) -> dict[str, np.ndarray]:
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise UserError(
            f"{path}: not a CSV table with one header line, perhaps truncated: {error}"
        ) from None
    return {str(name): table[name].to_numpy() for name in table.columns}


class _Columns:
    """Picks columns by name and unit, and checks what they hold."""

    def __init__(self, path: Path, columns: Mapping[str, np.ndarray]) -> None:
        self.path, self.columns = path, columns
        self.used: list[str] = []
        self.notes: list[str] = []
        if any(len(values) == 0 for values in columns.values()) or not columns:
            raise UserError(f"{path}: the table has no rows; expected one row per sample")

    def position(self, arm: str) -> np.ndarray:
        """Tip positions [T, 3], m."""
        return np.stack([self.one(f"{arm}_{axis}", LENGTHS, needed=True) for axis in "xyz"], axis=1)

    def quat(self, arm: str) -> np.ndarray | None:
        """Unit quaternions [T, 4], None where the file has none."""
        turns = [self.plain(f"{arm}_q{c}") for c in "xyzw"]
        present = [turn for turn in turns if turn is not None]
        if not present:
            return None
        if len(present) < 4:
            absent = [f"{arm}_q{c}" for c, turn in zip("xyzw", turns, strict=True) if turn is None]
            raise UserError(
                f"{self.path}: an orientation needs {arm}_qx, _qy, _qz and _qw; {', '.join(absent)}"
                " missing"
            )
        return unit_quaternions(self.path, arm, np.stack(present, axis=1))

    def one(self, name: str, units: dict[str, float], needed: bool = False) -> Any:
        """The column `name`_<unit> in the base unit; None where it is absent and not needed."""
        names = [f"{name}_{unit}" for unit in units if f"{name}_{unit}" in self.columns]
        if len(names) > 1:
            raise UserError(
                f"{self.path}: columns {' and '.join(names)} say the same; keep one of them"
            )
        if names:
            return self._numbers(names[0]) * units[names[0].rpartition("_")[2]]
        if not needed:
            return None
        wanted = f"{name}_um"
        raise UserError(
            f"{self.path}: no column {' or '.join(f'{name}_{unit}' for unit in units)}; the file"
            f" has {self._listed()}{suggestion(wanted, [c for c in self.columns if c != wanted])}"
        )

    def plain(self, name: str) -> Any:
        """The column of that name, or None."""
        return self._numbers(name) if name in self.columns else None

    def times(self, arms: Iterable[str]) -> dict[str, np.ndarray]:
        """What may be a time: every column but those of an arm and the pedal; those with a unit
        checked.
        """
        others = {
            name: v
            for name, v in self.columns.items()
            if name != PEDAL and not name.startswith(_of_an_arm)
        }
        return {
            name: (
                values
                if values.dtype.kind in "iumM" or name not in stamps.KNOWN
                else self._numbers(name)
            )
            for name, values in others.items()
        }

    def _listed(self) -> str:
        names = list(self.columns)
        return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")

    def _numbers(self, name: str) -> np.ndarray:
        values = self.columns[name]
        if name not in stamps.KNOWN:
            self.used.append(name)
        if values.dtype.kind in "mM":
            raise UserError(
                f"{self.path}: column {name} holds dates or durations, expected numbers"
            )
        try:
            numbers = np.asarray(values, float)
        except (TypeError, ValueError):
            row, value = _first_text(values)
            raise UserError(
                f"{self.path}: row {row}, column {name}: got {value!r}, expected a number"
            ) from None
        if (bad := np.flatnonzero(~np.isfinite(numbers))).size:
            raise UserError(
                f"{self.path}: row {bad[0]}, column {name}: got {numbers[bad[0]]}, expected a"
                f" finite number ({bad.size} such rows). Fill or cut them: a missing sample is not"
                " a position"
            )
        return numbers


_of_an_arm = tuple(f"{arm}_" for arm in ARMS)


def _first_text(values: Iterable[Any]) -> tuple[int, Any]:
    for row, value in enumerate(values):
        try:
            float(value)
        except (TypeError, ValueError):
            return row, value
    return 0, None
