"""Reads a recording from a Parquet or CSV table. The package's docstring lists the columns."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ravenjax.errors import UserError, suggestion
from ravenjax.store.logs.topics import ARM_TOPICS
from ravenjax.store.motion import stamps
from ravenjax.store.motion.summary import listed
from ravenjax.store.motion.track import LENGTHS, ArmTrack, Track, unit_quaternions

if TYPE_CHECKING:
    import pandas as pd

ANGLES = {"rad": 1e3, "mrad": 1.0, "deg": 1e3 * math.pi / 180.0}
"""Factors to mrad."""
PEDAL = "surgeon_mode"


def arms_in(table: pd.DataFrame) -> tuple[str, ...]:
    """Return the arms for which a table has positions, by the names of its columns."""
    return tuple(
        arm for arm in ARM_TOPICS if any(str(name).startswith(f"{arm}_x_") for name in table)
    )


def read_track(
    path: Path, table: pd.DataFrame, arms: tuple[str, ...], rate_hz: float | None
) -> Track:
    """Return the recording of `arms` in a table.

    Raises UserError that names file, row, column and problem.
    """
    if len(table) < 2:
        held = f"holds {len(table)} rows" if len(table) else "the table has no rows"
        raise UserError(f"{path}: {held}; expected a motion of at least 2")
    used: list[str] = []

    def numbers(name: str) -> np.ndarray:
        used.append(name)
        return _numbers(path, table, name)

    def quantity(name: str, units: dict[str, float]) -> np.ndarray | None:
        """Return the column `name`_<unit>, converted to the base unit."""
        names = [f"{name}_{unit}" for unit in units if f"{name}_{unit}" in table]
        if len(names) > 1:
            raise UserError(f"{path}: columns {' and '.join(names)} say the same; keep one of them")
        return numbers(names[0]) * units[names[0].rpartition("_")[2]] if names else None

    def place(name: str) -> np.ndarray:
        values = quantity(name, LENGTHS)
        if values is None:
            columns = list(map(str, table))
            raise UserError(
                f"{path}: no column {' or '.join(f'{name}_{unit}' for unit in LENGTHS)}; the file"
                f" has {listed(columns, 12)}{suggestion(f'{name}_um', columns)}"
            )
        return values

    def turns(arm: str) -> np.ndarray | None:
        names = [f"{arm}_q{c}" for c in "xyzw"]
        missing = [name for name in names if name not in table]
        if len(missing) == 4:
            return None
        if missing:
            raise UserError(
                f"{path}: an orientation needs {', '.join(names)}; {', '.join(missing)} missing"
            )
        return unit_quaternions(path, arm, np.stack([*map(numbers, names)], axis=1))

    times = stamps.time_columns(table)
    if len(times) > 1:
        raise UserError(f"{path}: columns {' and '.join(times)} say the same; keep one of them")
    time = times[0] if times else None
    time_s, clock, notes = stamps.sample_times(
        path, time, None if time is None else _numbers(path, table, time), len(table), rate_hz
    )
    if time is not None and rate_hz is None:
        used.append(time)
    tracks = {
        arm: ArmTrack(
            time_s,
            np.stack([place(f"{arm}_{axis}") for axis in "xyz"], axis=1),
            turns(arm),
            quantity(f"{arm}_grasp", ANGLES),
        )
        for arm in arms
    }
    pedal = numbers(PEDAL) if PEDAL in table else None
    if pedal is not None and (bad := np.flatnonzero((pedal != 0.0) & (pedal != 1.0))).size:
        raise UserError(
            f"{path}: row {bad[0]}, column {PEDAL}: got {pedal[bad[0]]:g}, expected 1 (pedal down)"
            " or 0"
        )
    return Track(
        path=path,
        clock=clock,
        arms=tracks,
        surgeon_mode=pedal,
        read=tuple(name for name in table if name in used),
        ignored=tuple(str(name) for name in table if name not in used),
        notes=notes,
    )


def _numbers(path: Path, table: pd.DataFrame, name: str) -> np.ndarray:
    """Return a column's numbers; integers stay integers.

    Raises UserError that names the first row without a number.
    """
    import pandas as pd

    values = np.asarray(table[name])
    if values.dtype.kind in "iu":
        return values
    numbers = np.full(len(values), np.nan)
    if values.dtype.kind not in "mM":
        numbers = np.asarray(pd.to_numeric(table[name], errors="coerce"), float)
    if (bad := np.flatnonzero(~np.isfinite(numbers))).size:
        raise UserError(
            f"{path}: row {bad[0]}, column {name}: got {values[bad[0]]}, expected a finite number"
            f" ({bad.size} such rows). Fill or cut them: a missing sample is not a position"
        )
    return numbers
