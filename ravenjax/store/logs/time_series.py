"""Every time series of one run: name, axes, unit and meaning, in the order in which they are
stored; and all of a run as a CSV file or an xarray.Dataset.

The series of a run are a dict of arrays [T] or [T, ...], one row a millisecond: `runlevel`, and
`gold/jpos` for what each arm has. Trace files, CSV files and datasets take units and meanings from
here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.errors import StoreError
from ravenjax.store.files import write_aside
from ravenjax.vocabulary.robot import Robot

if TYPE_CHECKING:
    import xarray

_PLACES = ("x", "y", "z")


def axes(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Names along an axis; others count from 0."""
    return {"joint": robot.joints, "axis": _PLACES, "jaw_axis": _PLACES}


class TimeSeries(NamedTuple):
    """One quantity."""

    name: str  # without the arm
    unit: str  # of a joint: of a revolute one
    meaning: str
    axes: tuple[str, ...] = ()  # beside the time
    linear_unit: str = ""  # of a joint that slides, where it differs


def _joints(name: str, unit: str, meaning: str, linear_unit: str = "") -> TimeSeries:
    return TimeSeries(name, unit, meaning, ("joint",), linear_unit)


def _place(name: str, meaning: str) -> TimeSeries:
    return TimeSeries(name, "m", meaning + ", frame 0 of the arm", ("axis",))


def _rotation(name: str, meaning: str) -> TimeSeries:
    return TimeSeries(
        name, "1", meaning + ": columns are the axes of the jaws in frame 0", ("axis", "jaw_axis")
    )


OF_RUN = {
    one.name: one
    for one in (
        TimeSeries(
            "runlevel",
            "1",
            "run level of the control software: 0 E-stop, 1 init, 2 pedal up, 3 pedal down",
        ),
        TimeSeries("surgeon_mode", "1", "1: the control software has heard that the pedal is down"),
        TimeSeries("last_seq", "1", "sequence number of the last accepted packet"),
        TimeSeries("soft_estopped", "1", "1: the control software holds its E-stop"),
        TimeSeries("pins_out", "1", "output byte of the control software to the PLC"),
        TimeSeries("plc_runlevel", "1", "run level that the PLC puts on its pins"),
        TimeSeries("brakes", "1", "1: the PLC commands the brakes on"),
        TimeSeries("packet_received", "1", "1: an operator packet arrived"),
        TimeSeries("fault_active", "1", "1: the window of this fault is open", ("fault",)),
        TimeSeries("tip_distance_mm", "mm", "distance of the two tips"),
    )
}
"""What belongs to no arm. `fault_active` is stored as one series a fault: fault0_active,
fault1_active, ...
"""

OF_ARM = {
    one.name: one
    for one in (
        _joints("enc_val_cnt", "counts", "encoders as the control software reads them"),
        _joints("mpos", "rad", "motor positions that the control software estimates"),
        _joints("mvel", "rad/s", "motor velocities that the control software estimates"),
        _joints("jpos", "rad", "joints as the control software measures them", "m"),
        _joints("jvel", "rad/s", "joint velocities as the control software measures them", "m/s"),
        _joints("jpos_d", "rad", "desired joints", "m"),
        _joints("mpos_d", "rad", "desired motor positions"),
        _joints("tau_d", "N m", "desired torque at the capstan"),
        _joints("current_cmd_cnt", "counts", "DAC command before the overdrive check"),
        _joints("dac_cnt", "counts", "DAC command as written to USB"),
        _joints(
            "boards_cnt", "counts", "DAC command that the USB boards hold and hand to the motors"
        ),
        _place("position", "tip as the robot reports it"),
        _rotation("rotation", "orientation of the jaws as the robot reports it"),
        _place("position_d", "desired tip"),
        _rotation("rotation_d", "desired orientation of the jaws"),
        _joints("link_jpos", "rad", "true joints", "m"),
        _joints("link_jvel", "rad/s", "true joint velocities", "m/s"),
        _joints("motor_mpos", "rad", "true motor positions"),
        _joints("motor_mvel", "rad/s", "true motor velocities"),
        _joints("cable_tension", "N", "tension difference of each cable"),
        _place("tip", "true tip"),
        _rotation("tip_rotation", "true orientation of the jaws"),
        _place("model_position", "tip of the nominal model"),
        _rotation("model_rotation", "orientation of the jaws of the nominal model"),
        _joints("model_jpos", "rad", "joints of the nominal model", "m"),
        TimeSeries("tip_error_mm", "mm", "distance of the reported tip from the nominal model's"),
        TimeSeries(
            "haptic_force",
            "device units",
            "force of the first haptic cue, frame 0 of the arm",
            ("axis",),
        ),
        TimeSeries("cue_force", "device units", "size of the force of each haptic cue", ("cue",)),
        TimeSeries(
            "tissue_depth_mm",
            "mm",
            "depth of the true tip below the tissue's surface, negative above",
        ),
        TimeSeries(
            "contact_force",
            "N",
            "force of all that the instrument touches, frame 0 of the arm",
            ("axis",),
        ),
        TimeSeries("contact_tissue_n", "N", "size of the force of tissue and vessel"),
        TimeSeries("contact_vessel_n", "N", "size of the force of the vessel"),
        TimeSeries("contact_instrument_n", "N", "size of the force of the other instrument"),
        _place("golden_tip", "true tip of the golden run, the same run without the fault"),
    )
}
"""What each arm has."""


def check(series: Mapping[str, np.ndarray], where: str) -> int:
    """The number of ticks that all series have. StoreError, beginning with `where`, where they
    differ or have none.
    """
    lengths = {name: values.shape[0] if values.ndim else 0 for name, values in series.items()}
    counts = set(lengths.values())
    if len(counts) != 1 or 0 in counts:
        listing = ", ".join(f"{name} {length}" for name, length in list(lengths.items())[:6])
        raise StoreError(
            f"{where}: a trace needs series of one length, at least 1 tick each, got"
            f" {listing or 'none'}"
        )
    return counts.pop()


def described(name: str) -> TimeSeries:
    """What a stored series is, by its stored name; one that is not listed here has unit "" and
    no meaning.
    """
    arm, _, own = name.rpartition("/")
    if arm:
        return OF_ARM.get(own) or TimeSeries(own, "", "")
    if re.fullmatch(r"fault\d+_active", name):
        return OF_RUN["fault_active"]._replace(name=name, axes=())
    return OF_RUN.get(name) or TimeSeries(name, "", "")


def scalars(robot: Robot, name: str, shape: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    """(name, unit) of each number of a series, last axis fastest: gold/jpos/elbow, rad. `shape`:
    without the time.
    """
    one = described(name)
    along = one.axes if len(one.axes) == len(shape) else ("",) * len(shape)
    names = axes(robot)
    for place in np.ndindex(shape):
        steps = [
            _step(names.get(axis, ()), i, size)
            for axis, i, size in zip(along, place, shape, strict=True)
        ]
        unit = one.linear_unit if one.linear_unit and set(robot.linear) & set(steps) else one.unit
        yield "/".join([name, *steps]), unit


def _step(names: tuple[str, ...], place: int, size: int) -> str:
    return names[place] if len(names) == size else str(place)


def write_csv(path: Path, series: Mapping[str, np.ndarray], robot: Robot = robots.USUAL) -> None:
    """Write the series of one run: time_s, then each number as `gold/jpos/elbow [rad]`; empty where
    there is none.

    Numbers are in single precision, seven digits, as a campaign computes them.
    Raises StoreError where the series do not have the same number of ticks or the disk refuses.
    """
    import pyarrow as pa
    from pyarrow import csv

    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = check(arrays, str(path))
    columns: dict[str, pa.Array] = {"time_s": pa.array(np.arange(ticks) / 1000)}
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values.reshape(ticks, -1).T)
        for (scalar, unit), numbers in zip(
            scalars(robot, name, values.shape[1:]), flat, strict=True
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


def dataset(
    series: Mapping[str, np.ndarray],
    attributes: Mapping[str, str | float | int],
    thresholds_mm: Sequence[float] = (),
    robot: Robot = robots.USUAL,
) -> xarray.Dataset:
    """The series of a run, those of this module, as one variable a quantity.

    Dimensions: time (s), arm, joint, axis (of frame 0), jaw_axis, cue and fault (numbers from 0);
    each has a coordinate, and cue_threshold_mm goes along cue. attrs of a variable: units,
    long_name, and insertion_units where those of the insertion differ. attributes: attrs of the
    whole. Raises StoreError where the series do not have the same number of ticks.
    """
    import xarray

    ticks = check(series, "simulate")
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
    names = axes(robot)
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
