"""Logs as tables, a row a sample: .csv and .parquet, and what `bag_file` makes of bags and MCAP
files.

Columns are named by joint, shoulder to grasp2; a log may leave joints out. In the order of
preference:

- `jpos_d_JOINT` and `jpos_JOINT`: desired and measured joints, rad and m;
- `mpos_d_JOINT` and `mpos_JOINT`: desired and measured motors, rad;
- `dac_JOINT`, `mpos_JOINT` and perhaps `mvel_JOINT`: what the robot was asked for is found from its
  PD law, for joints without an integral.

A name may end in `_deg` (motors and angles) or `_deg_s`. Time is `time_s`; without it the samples
are `period_ms` apart. Where there is `runlevel`, the longest stretch of raven2's pedal-down is the
log.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax.analyses.calibration import bag_file
from ravenjax.analyses.calibration.log import JointLog
from ravenjax.analyses.calibration.position_loop import Controller
from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.robots.raven2.geometry import limits, transmission
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN

ENDINGS = {"": 1.0, "_deg": np.pi / 180.0, "_deg_s": np.pi / 180.0}

LONGEST_S = 6 * 3600.0
"""Of a log: it is held in memory, a row a millisecond."""


def read(
    path: Path,
    arm: ArmName,
    tool: str,
    software: str,
    controller: Controller,
    period_ms: float | None = None,
) -> JointLog:
    """The log of one arm. UserError where the file or its columns are not of these."""
    table = _live(path, _table(path, arm))
    times = _times(path, table, period_ms)
    cycles = np.round(times * 1e3).astype(int)
    whole = np.arange(cycles[-1] + 1)
    desired, measured = _joints(path, table, arm, tool, software, controller)
    on_clock = np.stack([np.interp(whole, times * 1e3, column) for column in desired.T], axis=1)
    return JointLog(
        measured[0], on_clock, measured[1:], cycles[1:] - 1
    )  # a row is read before its cycle's command


def _table(path: Path, arm: ArmName) -> pd.DataFrame:
    if not path.exists():
        raise UserError(f"no log at {path}: expected {_EXPECTED}")
    if path.suffix in _READERS and not path.is_dir():
        try:
            return _READERS[path.suffix](path)
        except (
            ValueError,
            OSError,
            pa.ArrowException,
        ) as error:  # ValueErrors are pandas' own, and not UTF-8
            what = str(error).strip() or type(error).__name__
            raise UserError(
                f"{path}: no {path.suffix} table that can be read, perhaps cut: {what}"
            ) from None
    if path.suffix in bag_file.SUFFIXES or path.is_dir():
        return bag_file.table(path, arm)
    raise UserError(f"a log is {_EXPECTED}, got {path.name}")


_READERS: dict[str, Callable[[Path], pd.DataFrame]] = {
    ".csv": pd.read_csv,
    ".parquet": pd.read_parquet,
}
_EXPECTED = f"{', '.join((*_READERS, *bag_file.SUFFIXES))} or a folder of ROS 2"


def _live(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """The longest stretch of rows in which the robot could move, of at least two; all where no
    column says so.
    """
    if "runlevel" in table:
        live = table["runlevel"].to_numpy() == PEDAL_DOWN
        stretch = np.cumsum(np.diff(live, prepend=live[:1]) != 0)
        longest = np.bincount(stretch, live, minlength=1).argmax()
        table = table.loc[live & (stretch == longest)].reset_index(drop=True)
    if len(table) < 2:
        where = f" in pedal-down (runlevel {PEDAL_DOWN})" if "runlevel" in table else ""
        raise UserError(f"{path} has {len(table)} rows{where}; a log needs some seconds of motion")
    return table


def _times(path: Path, table: pd.DataFrame, period_ms: float | None) -> np.ndarray:
    """Seconds from the first sample, [n]."""
    if period_ms is not None:
        if not 0.0 < period_ms < np.inf:
            raise UserError(
                f"--period-ms {period_ms:g}: expected the milliseconds between two samples, above 0"
            )
        return _bounded(path, np.arange(len(table)) * period_ms * 1e-3)
    if "time_s" not in table:
        raise UserError(
            f"{path} has no column time_s: say how far apart its samples are, --period-ms 1"
        )
    times = _numbers(path, table, "time_s")
    if not (np.diff(times) > 0.0).all():
        row = int(np.flatnonzero(~(np.diff(times) > 0.0))[0]) + 1
        raise UserError(
            f"{path}: time_s does not increase at row {row}; with --period-ms it is not read"
        )
    return _bounded(path, times - times[0])


def _bounded(path: Path, times: np.ndarray) -> np.ndarray:
    """Itself; UserError for a log that is too long to be replayed, or hardly lasts."""
    if not (times[-1] <= LONGEST_S and round(times[-1] * 1e3) >= 1):
        raise UserError(
            f"{path} lasts {times[-1]:.4g} s, expected seconds of motion, at most {LONGEST_S:g}:"
            " write time_s in seconds, or cut the log"
        )
    return times


def _joints(
    path: Path, table: pd.DataFrame, arm: ArmName, tool: str, software: str, controller: Controller
) -> tuple[np.ndarray, np.ndarray]:
    """Desired [n, 7] and measured joints [n, 7], nan where the log has none; what it lacks is
    desired at home.
    """
    desired, measured = _quantity(path, table, "jpos_d"), _quantity(path, table, "jpos")
    if desired is None or measured is None:
        motors = _quantity(path, table, "mpos")
        targets = _quantity(path, table, "mpos_d")
        if motors is not None and targets is None:
            targets = _asked(path, table, motors, arm, tool, software, controller)
        if motors is None or targets is None:
            raise UserError(
                f"{path} has neither jpos_d and jpos, nor mpos_d and mpos, nor mpos and dac of any"
                " joint (as mpos_shoulder); its columns are"
                f" {', '.join(map(str, table.columns[:12]))}"
            )
        desired, measured = (
            _of_motors(angles, arm, tool, software) for angles in (targets, motors)
        )
    home = np.array([*limits.HOME_JPOS])
    return np.where(np.isnan(desired), home, desired), measured


def _quantity(path: Path, table: pd.DataFrame, name: str) -> np.ndarray | None:
    """Columns of a quantity [n, 7], nan where a joint is not logged; None where none is."""
    columns = np.full((len(table), len(JOINTS)), np.nan)
    for joint, word in enumerate(JOINTS):
        for ending, factor in ENDINGS.items():
            if f"{name}_{word}{ending}" in table:
                columns[:, joint] = _numbers(path, table, f"{name}_{word}{ending}") * factor
    return None if np.isnan(columns).all() else columns


def _numbers(path: Path, table: pd.DataFrame, name: str) -> np.ndarray:
    """A column [n]; nan where the log has nothing. UserError where it holds anything but
    numbers.
    """
    try:
        numbers = table[name].to_numpy(float)
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}: column {name} holds other things than numbers: {error}") from None
    if (infinite := np.flatnonzero(np.isinf(numbers))).size:
        raise UserError(
            f"{path}: row {infinite[0]}, column {name}: got {numbers[infinite[0]]}, expected a"
            " finite number"
        )
    return numbers


def _asked(
    path: Path,
    table: pd.DataFrame,
    motors: np.ndarray,
    arm: ArmName,
    tool: str,
    software: str,
    controller: Controller,
) -> np.ndarray | None:
    """Desired motor angles that the PD law implies, [n, 7]; nan where there is no command or an
    integral.
    """
    counts = _quantity(path, table, "dac")
    if counts is None:
        return None
    speed = _quantity(path, table, "mvel")
    speed = np.gradient(motors, 1e-3, axis=0) if speed is None else speed
    signs = np.array([*transmission.tau_signs(arm, tool, software)], float)
    torque = counts * signs / np.array([*transmission.COUNTS_PER_NM])
    kp, kd = (np.array([*gain]) for gain in (controller.kp, controller.kd))
    targets = motors + (torque + kd * speed) / kp
    return np.where(np.array([*controller.ki]) > 0.0, np.nan, targets)


def _of_motors(angles: np.ndarray, arm: ArmName, tool: str, software: str) -> np.ndarray:
    """Joints [n, 7] of motor angles [n, 7]; nan from the first unknown motor on."""
    columns = transmission.joint_from_motor(arm, tool, Vec(angles.T), software)
    return np.stack([np.asarray(column, float) for column in columns], axis=1)
