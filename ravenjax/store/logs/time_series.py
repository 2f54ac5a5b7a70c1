"""Describes every time series of a run, and writes CSV files and datasets.

The series of a run are a dict of arrays [T] or [T, ...], one row per millisecond. For example,
`runlevel` is a series of the robot and `gold/jpos` a series of an arm. Files store the series in
the order of the dict. The file time_series.csv lists all series.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ravenjax import robots
from ravenjax.errors import StoreError
from ravenjax.store.files import write_aside
from ravenjax.vocabulary.robot import Robot

if TYPE_CHECKING:
    import xarray

Series: TypeAlias = Mapping[str, np.ndarray]
"""Arrays [T, ...] by name, such as runlevel, or by arm and name, such as gold/jpos."""
_PLACES = ("x", "y", "z")
_WINDOW = re.compile(r"fault\d+_active")


def series_axes(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Return the names of the elements along each axis. Other axes have numbers from 0."""
    return {"joint": robot.joints, "axis": _PLACES, "jaw_axis": _PLACES}


class TimeSeries(NamedTuple):
    """Description of one time series."""

    name: str  # without the arm
    unit: str  # unit; if it differs between joints, the unit of a revolute joint
    meaning: str
    axes: tuple[str, ...] = ()  # axes in addition to time
    linear_unit: str = ""  # unit of a prismatic joint, if it differs


def _series_of(owner: str) -> dict[str, TimeSeries]:
    # Reads the time series of one owner, a robot or the common series, from this module's CSV file.
    with open(Path(__file__).with_suffix(".csv"), encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("of") == owner]
    return {
        row["name"]: TimeSeries(axes=tuple(row.pop("axes").split()), **row)  # type: ignore[arg-type]
        for row in rows
    }


OF_RUN = _series_of("run")
"""Series of the whole robot.

`fault_active` is stored as one series per fault: fault0_active, fault1_active, ...
"""
OF_ARM = _series_of("arm")
"""Series of each arm."""


def check_series(series: Series, where: str) -> int:
    """Return the number of ticks of all series. Raise StoreError if the numbers differ or are 0.
    where: beginning of the message.
    """
    lengths = {name: values.shape[0] if values.ndim else 0 for name, values in series.items()}
    counts = set(lengths.values())
    if len(counts) != 1 or 0 in counts:
        listing = ", ".join(f"{name} {length}" for name, length in list(lengths.items())[:6])
        raise StoreError(
            f"{where}: expected series with the same number of ticks, at least 1, got"
            f" {listing or 'no series'}"
        )
    return counts.pop()


def describe_series(name: str) -> TimeSeries:
    """Return the description of a stored series. An unknown series has no unit and no meaning."""
    arm, _, quantity = name.rpartition("/")
    if arm:
        return OF_ARM.get(quantity) or TimeSeries(quantity, "", "")
    # One fault of the series `fault_active`, whose only axis is the number of the fault.
    if _WINDOW.fullmatch(name):
        return OF_RUN["fault_active"]._replace(name=name, axes=())
    return OF_RUN.get(name) or TimeSeries(name, "", "")


def series_scalars(robot: Robot, name: str, shape: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    """Yield (name, unit) of each number of a series, such as (gold/jpos/elbow, rad). The last axis
    varies fastest. shape: shape of the series without time.
    """
    series = describe_series(name)
    # An axis without a name, as in an unknown series, has numbers instead of labels.
    axes = series.axes if len(series.axes) == len(shape) else ("",) * len(shape)
    labels = series_axes(robot)
    for indices in np.ndindex(shape):
        parts, unit = [name], series.unit
        for axis, index, size in zip(axes, indices, shape, strict=True):
            words = labels.get(axis, ())
            parts.append(words[index] if len(words) == size else str(index))
            # Numbers of a prismatic joint have the unit of prismatic joints, if there is one.
            if parts[-1] in robot.linear:
                unit = series.linear_unit or unit
        yield "/".join(parts), unit


def write_csv(path: Path, series: Series, robot: Robot = robots.USUAL) -> None:
    """Write the series of one run as CSV, with columns time_s, `gold/jpos/elbow [rad]` and so on.
    Numbers are in single precision, with seven digits. NaN is an empty cell. Raise StoreError if
    the numbers of ticks differ or the file cannot be written.
    """
    import pyarrow as pa
    from pyarrow import csv

    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = check_series(arrays, str(path))
    columns: dict[str, pa.Array] = {"time_s": pa.array(np.arange(ticks) / 1000)}
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values.reshape(ticks, -1).T)  # [scalars, ticks]
        scalars = series_scalars(robot, name, values.shape[1:])
        for (scalar, unit), numbers in zip(scalars, flat, strict=True):
            label = f"{scalar} [{unit}]" if unit not in ("", "1") else scalar
            columns[label] = pa.array(_short(numbers), from_pandas=True)
    table = pa.table(columns)
    options = csv.WriteOptions(quoting_style="none")
    write_aside(path, lambda target: csv.write_csv(table, target, options))


def _short(numbers: np.ndarray) -> np.ndarray:
    if numbers.dtype.kind == "f":
        return numbers.astype(np.float32)
    return numbers.astype(np.int8) if numbers.dtype == bool else numbers


def series_dataset(
    series: Series, attributes: Mapping[str, object], thresholds_mm: Sequence[float], robot: Robot
) -> xarray.Dataset:
    """Return the series of a run as a Dataset with one variable per quantity. Dimensions: time (s),
    arm, joint, axis (of frame 0), jaw_axis, cue and fault (numbers from 0). Each dimension has a
    coordinate. The coordinate cue_threshold_mm also belongs to cue. attrs of a variable: units,
    long_name, and insertion_units if the insertion has another unit. attributes: attrs of the
    dataset. Raise StoreError if the numbers of ticks differ.
    """
    import xarray

    ticks = check_series(series, "simulate")
    arms = [arm for arm in robot.arms if any(name.startswith(f"{arm}/") for name in series)]
    variables: dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]] = {}
    for one in OF_RUN.values():
        if one.name in series:
            variables[one.name] = (("time", *one.axes), series[one.name], _attributes(one))
    # The length comes first, so that fault 10 comes after fault 9.
    if windows := sorted(filter(_WINDOW.fullmatch, series), key=lambda name: (len(name), name)):
        dims, about = ("time", "fault"), _attributes(OF_RUN["fault_active"])
        values = np.stack([series[name] for name in windows], axis=1)
        variables["fault_active"] = (dims, values, about)
    for one in OF_ARM.values():
        if arms and all(f"{arm}/{one.name}" in series for arm in arms):
            values = np.stack([series[f"{arm}/{one.name}"] for arm in arms], axis=1)
            variables[one.name] = (("time", "arm", *one.axes), values, _attributes(one))
    sizes = {
        dim: size
        for dims, values, _ in variables.values()
        for dim, size in zip(dims, values.shape, strict=True)
    }
    coordinates: dict[str, object] = {
        "time": ("time", np.arange(ticks) / 1000, {"units": "s"}),
        "arm": arms,
    }
    names = series_axes(robot)
    coordinates |= {
        dim: list(names.get(dim, range(size)))
        for dim, size in sizes.items()
        if dim not in ("time", "arm")
    }
    if thresholds_mm and "cue" in sizes:
        coordinates["cue_threshold_mm"] = ("cue", list(thresholds_mm), {"units": "mm"})
    return xarray.Dataset(variables, coordinates, attributes)


def _attributes(one: TimeSeries) -> dict[str, str]:
    insertion = {"insertion_units": one.linear_unit} if one.linear_unit else {}
    return {"units": one.unit, "long_name": one.meaning, **insertion}
