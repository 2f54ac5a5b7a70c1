"""Reads what an operator's recording holds: Parquet, CSV or MCAP. `motion_file` makes a motion of it.

Tables have one row per sample and these columns; the suffix alone says the unit:

    time_s | time_ms | time_us | time_ns       optional; without it a row is a millisecond
    <arm>_x_<m|mm|um>, _y_, _z_                desired tip position in frame 0 of the arm, for each arm used
    <arm>_qx, _qy, _qz, _qw                    optional, tip orientation in frame 0
    <arm>_grasp_<rad|mrad|deg>                 optional, jaw opening, positive opens
    surgeon_mode                               optional, 1 pedal down, 0 up

MCAP files have geometry_msgs/PoseStamped on /arm1/setpoint_cp, else /arm1/measured_cp (arm1 is gold, arm2 green), and
optionally sensor_msgs/JointState on /arm1/setpoint_js, else measured_js, for the jaws: as `ravenjax trace` writes them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.errors import UserError, suggestion
from ravenjax.types import ARMS, ArmName

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
ANGLES = {"rad": 1e3, "mrad": 1.0, "deg": 1e3 * math.pi / 180.0}
"""Factors to mrad."""
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclasses.dataclass(frozen=True)
class ArmTrack:
    """One arm's recording of T samples."""

    position: np.ndarray  # [T, 3] m, tip in frame 0
    quat: np.ndarray | None  # [T, 4] x, y, z, w, tip in frame 0
    opening_mrad: np.ndarray | None  # [T] positive opens


@dataclasses.dataclass(frozen=True)
class Track:
    """A whole recording."""

    path: Path
    time_s: np.ndarray | None  # [T] from 0
    arms: dict[ArmName, ArmTrack]
    surgeon_mode: np.ndarray | None  # [T]

    def __len__(self) -> int:
        return len(next(iter(self.arms.values())).position)


def read(path: Path, arms: tuple[ArmName, ...]) -> Track:
    """The recording of `arms` in a file. UserError names file, row and column of what is wrong with it."""
    if not path.is_file():
        raise UserError(f"{path}: no such file; expected a recorded operator motion (.parquet, .csv or .mcap)")
    if path.stat().st_size == 0:
        raise UserError(f"{path}: the file is empty; expected a recorded operator motion")
    kind = path.suffix.lower()
    if kind == ".mcap":
        from ravenjax.store import motion_mcap

        return _from_columns(path, motion_mcap.columns(path, arms), arms)
    if kind not in (".parquet", ".csv"):
        raise UserError(f"{path}: unknown kind of file {kind!r}; expected .parquet, .csv or .mcap")
    return _from_columns(path, _parquet(path) if kind == ".parquet" else _csv(path), arms)


def _parquet(path: Path) -> dict[str, np.ndarray]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        names = pq.read_schema(path).names
        table = pq.read_table(path, columns=[name for name in names if _known(name)] or names[:1])
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        what = str(error).splitlines()[0]
        raise UserError(
            f"{path}: not a complete Parquet file, perhaps truncated: {what}. Copy or record it again"
        ) from None
    found = {name: table[name].to_numpy() for name in table.column_names}
    return {name: found.get(name, np.zeros(len(table))) for name in names}  # of what nobody reads, the name alone


def _known(name: str) -> bool:
    """Whether a column may be asked for."""
    return name == "surgeon_mode" or name.startswith(("time_", *(f"{arm}_" for arm in ARMS)))


def _csv(path: Path) -> dict[str, np.ndarray]:
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: not a CSV table with one header line, perhaps truncated: {error}") from None
    return {str(name): table[name].to_numpy() for name in table.columns}


def _from_columns(path: Path, columns: dict[str, np.ndarray], arms: tuple[ArmName, ...]) -> Track:
    picked = _Columns(path, columns)
    time = picked.one("time", TIMES)
    tracks: dict[ArmName, ArmTrack] = {}
    for arm in arms:
        places = [picked.one(f"{arm}_{axis}", LENGTHS, needed=True) for axis in "xyz"]
        turns = [picked.plain(f"{arm}_q{c}") for c in "xyzw"]
        if any(turn is None for turn in turns) and any(turn is not None for turn in turns):
            absent = [f"{arm}_q{c}" for c, turn in zip("xyzw", turns, strict=True) if turn is None]
            raise UserError(f"{path}: an orientation needs {arm}_qx, _qy, _qz and _qw; {', '.join(absent)} missing")
        quat = np.stack([t for t in turns if t is not None], axis=1) if turns[0] is not None else None
        tracks[arm] = ArmTrack(
            position=np.stack([p for p in places if p is not None], axis=1),
            quat=_unit(path, arm, quat),
            opening_mrad=picked.one(f"{arm}_grasp", ANGLES),
        )
    if time is not None:
        time = time - time[0]
    track = Track(path, time, tracks, picked.plain("surgeon_mode"))
    if len(track) < 2:
        raise UserError(f"{path}: holds {len(track)} rows; expected a motion of at least 2")
    return track


def _unit(path: Path, arm: str, quat: np.ndarray | None) -> np.ndarray | None:
    if quat is None:
        return None
    length = np.linalg.norm(quat, axis=1)
    if (length == 0.0).all():  # how a trace without rotations writes them
        return None
    if (bad := np.flatnonzero(np.abs(length - 1.0) > 1e-2)).size:
        raise UserError(
            f"{path}: row {bad[0]}: quaternion {arm}_qx.. has length {length[bad[0]]:.4g}, expected 1 (x, y, z, w)"
        )
    return quat / length[:, None]


class _Columns:
    """Picks columns by name and unit, and checks what they hold."""

    def __init__(self, path: Path, columns: dict[str, np.ndarray]) -> None:
        self.path, self.columns = path, columns
        if any(len(values) == 0 for values in columns.values()) or not columns:
            raise UserError(f"{path}: the table has no rows; expected one row per sample")

    def one(self, name: str, units: dict[str, float], needed: bool = False) -> Any:
        """The column `name`_<unit> in the base unit; None where it is absent and not needed."""
        found = [f"{name}_{unit}" for unit in units if f"{name}_{unit}" in self.columns]
        if len(found) > 1:
            raise UserError(f"{self.path}: columns {' and '.join(found)} say the same; keep one of them")
        if found:
            return self._numbers(found[0]) * units[found[0].rpartition("_")[2]]
        if not needed:
            return None
        wanted = f"{name}_um"
        raise UserError(
            f"{self.path}: no column {' or '.join(f'{name}_{unit}' for unit in units)}; the file has "
            f"{self._listed()}{suggestion(wanted, [c for c in self.columns if c != wanted])}"
        )

    def plain(self, name: str) -> Any:
        """The column of that name, or None."""
        return self._numbers(name) if name in self.columns else None

    def _listed(self) -> str:
        names = list(self.columns)
        return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")

    def _numbers(self, name: str) -> np.ndarray:
        values = self.columns[name]
        if values.dtype.kind in "mM":
            raise UserError(f"{self.path}: column {name} holds dates or durations, expected numbers")
        if name.startswith("time_") and np.issubdtype(values.dtype, np.integer):
            return (values - values[0]).astype(float)  # nanoseconds since 1970 do not fit a double
        try:
            numbers = np.asarray(values, float)
        except (TypeError, ValueError):
            row, value = _first_text(values)
            raise UserError(f"{self.path}: row {row}, column {name}: got {value!r}, expected a number") from None
        if (bad := np.flatnonzero(~np.isfinite(numbers))).size:
            raise UserError(
                f"{self.path}: row {bad[0]}, column {name}: got {numbers[bad[0]]}, expected a finite number "
                f"({bad.size} such rows). Fill or cut them: a missing sample is not a position"
            )
        return numbers


def _first_text(values: Iterable[Any]) -> tuple[int, Any]:
    for row, value in enumerate(values):
        try:
            float(value)
        except (TypeError, ValueError):
            return row, value
    return 0, None
