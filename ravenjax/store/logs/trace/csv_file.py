"""One run's time series as a CSV file: a row a millisecond, a column a number, its unit in the
column's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ravenjax import robots
from ravenjax.store.files import write_aside
from ravenjax.store.logs import time_series
from ravenjax.vocabulary.robot import Robot


def write(path: Path, series: Mapping[str, np.ndarray], robot: Robot = robots.USUAL) -> None:
    """Write the series of one run: time_s, then each number as `gold/jpos/elbow [rad]`; empty where
    there is none.

    Numbers are in single precision, seven digits, as a campaign computes them.
    Raises StoreError where the series do not have the same number of ticks or the disk refuses.
    """
    import pyarrow as pa
    from pyarrow import csv

    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = time_series.check(arrays, str(path))
    columns: dict[str, pa.Array] = {"time_s": pa.array(np.arange(ticks) / 1000)}
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values.reshape(ticks, -1).T)
        for (scalar, unit), numbers in zip(
            time_series.scalars(robot, name, values.shape[1:]), flat, strict=True
        ):
            label = f"{scalar} [{unit}]" if unit not in ("", "1") else scalar
            columns[label] = pa.array(_short(numbers), from_pandas=True)
    table = pa.table(columns)
    write_aside(
        path, lambda target: csv.write_csv(table, target, csv.WriteOptions(quoting_style="none"))
    )


def _short(numbers: np.ndarray) -> np.ndarray:
    if numbers.dtype.kind == "f":
        return numbers.astype(np.float32)
    return numbers.astype(np.int8) if numbers.dtype == bool else numbers
