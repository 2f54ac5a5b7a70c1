"""The time series of one run as an xarray.Dataset, with names along every axis and units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ravenjax import robots
from ravenjax.store.logs import time_series
from ravenjax.store.logs.time_series import OF_ARM, OF_RUN, TimeSeries
from ravenjax.vocabulary.robot import Robot

if TYPE_CHECKING:
    import xarray


def dataset(
    series: Mapping[str, np.ndarray],
    attributes: Mapping[str, str | float | int],
    thresholds_mm: Sequence[float] = (),
    robot: Robot = robots.USUAL,
) -> xarray.Dataset:
    """The series of a run, those of `time_series`, as one variable a quantity.

    Dimensions: time (s), arm, joint, axis (of frame 0), jaw_axis, cue and fault (numbers from 0);
    each has a coordinate, and cue_threshold_mm goes along cue. attrs of a variable: units,
    long_name, and insertion_units where those of the insertion differ. attributes: attrs of the
    whole. Raises StoreError where the series do not have the same number of ticks.
    """
    import xarray

    ticks = time_series.check(series, "simulate")
    arms = [arm for arm in robot.arms if any(name.startswith(f"{arm}/") for name in series)]
    variables: dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]] = {}
    for one in OF_RUN.values():
        if one.name in series:
            variables[one.name] = (("time", *one.axes), series[one.name], _attributes(one))
    if windows := [series[name] for name in sorted(filter(_WINDOW.fullmatch, series), key=_slot)]:
        variables["fault_active"] = (
            ("time", "fault"),
            np.stack(windows, axis=1),
            _attributes(OF_RUN["fault_active"]),
        )
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
    names = time_series.axes(robot)
    coordinates |= {
        dim: list(names.get(dim, range(size)))
        for dim, size in sizes.items()
        if dim not in ("time", "arm")
    }
    if thresholds_mm and "cue" in sizes:
        coordinates["cue_threshold_mm"] = ("cue", list(thresholds_mm), {"units": "mm"})
    return xarray.Dataset(variables, coordinates, attributes)


_WINDOW = re.compile(r"fault\d+_active")


def _slot(name: str) -> int:
    return int(name.removeprefix("fault").removesuffix("_active"))


def _attributes(one: TimeSeries) -> dict[str, str]:
    insertion = {"insertion_units": one.linear_unit} if one.linear_unit else {}
    return {"units": one.unit, "long_name": one.meaning, **insertion}
