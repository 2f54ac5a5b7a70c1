"""Reads the log of one arm: desired and measured joints on the clock of the control cycle.

A table (.csv, .parquet) has one row per sample. Its columns are named by joint, shoulder to grasp2.
A log may leave joints out. Columns are used in this order of preference:

- `jpos_d_JOINT` and `jpos_JOINT`: desired and measured joints, rad and m;
- `mpos_d_JOINT` and `mpos_JOINT`: desired and measured motors, rad;
- `dac_JOINT`, `mpos_JOINT` and optionally `mvel_JOINT`: the desired joints are computed from the
  robot's PD law, for joints without an integral.

A name may end in `_deg` (motors and angles) or `_deg_s`. Time is `time_s`; without it the samples
are `period_ms` apart. If there is a column `runlevel`, the longest stretch in raven2's pedal-down
is the log.

A bag of ROS 1 or ROS 2 is converted to such a table, from one of

- raven2's `raven_2/raven_state`: jpos and jpos_d of both arms in its slots, all multiplied by
  180/pi, the insertion too;
- CRTK's `/arm1/measured_js` and `/arm1/setpoint_js` (arm1 is gold, arm2 green), rad and m. raven2
  publishes the measurements of one arm under the other arm's name (branch crtk,
  src/raven/local_io.cpp). So the measured joints of an arm are taken to be those that follow its
  setpoint.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.calibration.position_loop import Controller
from ravenjax.errors import UserError, listed
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, JOINTS, ArmName
from ravenjax.robots.raven2.geometry import limits, transmission
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN
from ravenjax.store import files
from ravenjax.store.logs import bags
from ravenjax.store.logs.topics import ARM_TOPICS

ENDINGS = {"": 1.0, "_deg": np.pi / 180.0, "_deg_s": np.pi / 180.0}
LONGEST_S = 6 * 3600.0
"""Longest log in seconds. It is held in memory, with one row per millisecond."""
SLOTS = np.array([0, 1, 2, 4, 5, 6, 7])
"""Positions of the joints among the eight numbers of an arm in raven_state. The fourth is unused.
"""
PER_STATE = np.pi / 180.0
"""rad and m per unit of raven_state."""


class JointLog(NamedTuple):
    """The log of one arm. Columns are the seven joints: rad, and m for the insertion."""

    start: np.ndarray  # [7] joints at the start of the log; NaN if missing
    desired: np.ndarray  # [T, 7], one row per control cycle (1 ms)
    measured: np.ndarray  # [n, 7], measured at the motors; NaN if missing
    cycles: np.ndarray  # [n] cycle after which each row was measured

    @property
    def joints(self) -> list[int]:
        """Return the joints (0 to 6) that the log has."""
        return np.flatnonzero(~np.isnan(self.measured).all(axis=0)).tolist()

    def compared(self, begin: int, end: int) -> JointLog:
        """Return the log's cycles up to `end`. Those before `begin` are replayed but not
        compared.
        """
        rows = self.cycles < end
        measured = np.where((self.cycles >= begin)[:, None], self.measured, np.nan)
        return JointLog(self.start, self.desired[:end], measured[rows], self.cycles[rows])


def read_joint_log(
    path: Path,
    arm: ArmName,
    tool: str,
    software: str,
    controller: Controller,
    period_ms: float | None = None,
) -> JointLog:
    """Read the log of one arm. Raises UserError if the file or its columns have no
    supported form.
    """
    if path.is_dir() or (path.is_file() and path.suffix in bags.SUFFIXES):
        table = _read_bag(path, arm)
    elif path.is_file() and path.suffix in files.TABLES:
        table = files.read_table(path)
    else:
        kinds = ", ".join((*files.TABLES, *bags.SUFFIXES))
        raise UserError(f"{path}: expected the file of a log ({kinds}) or a folder of ROS 2")
    table = _pedal_down(path, table)
    times = _times(path, table, period_ms)
    cycles = np.round(times * 1e3).astype(int)
    whole = np.arange(cycles[-1] + 1)
    desired, measured = _joints(path, table, arm, tool, software, controller)
    on_clock = np.stack([np.interp(whole, times * 1e3, column) for column in desired.T], axis=1)
    # A row is read before its cycle's command.
    return JointLog(measured[0], on_clock, measured[1:], cycles[1:] - 1)


def _pedal_down(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """Return the longest stretch of rows in which the robot could move; all rows if no column shows
    it.
    """
    where = ""
    if "runlevel" in table:
        live = table["runlevel"].to_numpy() == PEDAL_DOWN
        stretch = np.cumsum(np.diff(live, prepend=live[:1]) != 0)
        longest = np.bincount(stretch, live, minlength=1).argmax()
        table = table.loc[live & (stretch == longest)].reset_index(drop=True)
        where = f" in pedal-down (runlevel {PEDAL_DOWN})"
    if len(table) < 2:
        raise UserError(f"{path} has {len(table)} rows{where}; a log needs some seconds of motion")
    return table


def _times(path: Path, table: pd.DataFrame, period_ms: float | None) -> np.ndarray:
    """Return seconds since the first sample, [n]."""
    if period_ms is not None:
        times = np.arange(len(table)) * period_ms * 1e-3
    elif "time_s" in table:
        times = _numbers(path, table, "time_s")
        times = times - times[0]
    else:
        raise UserError(
            f"{path} has no column time_s: say how far apart its samples are, --period-ms 1"
        )
    if (stuck := np.flatnonzero(~(np.diff(times) > 0.0))).size:
        raise UserError(
            f"{path}: time does not increase at row {stuck[0] + 1}; write --period-ms, above 0,"
            " and time_s is not read"
        )
    if not (times[-1] <= LONGEST_S and round(times[-1] * 1e3) >= 1):
        raise UserError(
            f"{path} lasts {times[-1]:.4g} s, expected seconds of motion, at most {LONGEST_S:g}:"
            " write time_s in seconds, or cut the log"
        )
    return times


def _joints(
    path: Path, table: pd.DataFrame, arm: ArmName, tool: str, software: str, controller: Controller
) -> tuple[np.ndarray, np.ndarray]:
    """Return desired [n, 7] and measured joints [n, 7]. Missing joints are measured as NaN and
    desired at home.
    """
    desired, measured = _quantity(path, table, "jpos_d"), _quantity(path, table, "jpos")
    if desired is None or measured is None:
        motors, targets = _quantity(path, table, "mpos"), _quantity(path, table, "mpos_d")
        counts = _quantity(path, table, "dac")
        if motors is not None and targets is None and counts is not None:
            # The PD law is solved for the desired angle. An integral term would prevent this.
            speed = _quantity(path, table, "mvel")
            speed = np.gradient(motors, 1e-3, axis=0) if speed is None else speed
            signs = np.array([*transmission.tau_signs(arm, tool, software)], float)
            torque = counts * signs / np.array([*transmission.COUNTS_PER_NM])
            kp, kd, ki = (
                np.array([*gain]) for gain in (controller.kp, controller.kd, controller.ki)
            )
            targets = np.where(ki > 0.0, np.nan, motors + (torque + kd * speed) / kp)
        if motors is None or targets is None:
            raise UserError(
                f"{path} has neither jpos_d and jpos, nor mpos_d and mpos, nor mpos and dac of any"
                " joint (as mpos_shoulder); its columns are"
                f" {', '.join(map(str, table.columns[:12]))}"
            )
        # If a motor is unknown, its joint and the following joints are unknown too.
        desired, measured = (
            np.stack(
                [
                    np.asarray(column, float)
                    for column in transmission.joint_from_motor(arm, tool, Vec(angles.T), software)
                ],
                axis=1,
            )
            for angles in (targets, motors)
        )
    home = np.array([*limits.HOME_JPOS])
    return np.where(np.isnan(desired), home, desired), measured


def _quantity(path: Path, table: pd.DataFrame, name: str) -> np.ndarray | None:
    """Return the columns of a quantity [n, 7], NaN for joints that are not logged; None if no joint
    is logged.
    """
    columns = np.full((len(table), len(JOINTS)), np.nan)
    for joint, word in enumerate(JOINTS):
        for ending, factor in ENDINGS.items():
            if f"{name}_{word}{ending}" in table:
                columns[:, joint] = _numbers(path, table, f"{name}_{word}{ending}") * factor
    return None if np.isnan(columns).all() else columns


def _numbers(path: Path, table: pd.DataFrame, name: str) -> np.ndarray:
    """Return a column [n], NaN for missing values. Raises UserError for values that are not
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


def _read_bag(path: Path, arm: ArmName) -> pd.DataFrame:
    """Return the table of a bag: time_s, jpos_d_JOINT and jpos_JOINT, and runlevel from
    raven_state.
    """
    with bags.open_bag(path) as reader:
        kinds = {one.topic: one.msgtype for one in reader.connections}
        state = next((topic for topic, kind in kinds.items() if kind.endswith("/raven_state")), "")
        if state:
            states = bags.read_topic(path, reader, state)
            slots = SLOTS + 8 * ARMS.index(arm)
            desired, measured = (
                np.array([getattr(one, name)[slots] for one in states.messages], float) * PER_STATE
                for name in ("jpos_d", "jpos")
            )
            columns = _columns(states.time_ns, desired, measured)
            return columns.assign(runlevel=[int(one.runlevel) for one in states.messages])

        def joint_topics(ends: list[str]) -> list[str]:
            return [
                topic
                for topic, kind in kinds.items()
                if kind.endswith("/JointState") and f"/{topic}".endswith(tuple(ends))
            ]

        setpoint = joint_topics([f"/{ARM_TOPICS[arm]}/setpoint_js"])
        measured_of = joint_topics([f"/{ARM_TOPICS[name]}/measured_js" for name in ARMS])
        if not setpoint or not measured_of:
            raise UserError(
                f"{path}: expected raven2's state, or /{ARM_TOPICS[arm]}/setpoint_js and"
                " measured_js of CRTK; the file has\n"
                + listed([f"{topic} ({kind})" for topic, kind in sorted(kinds.items())] or ["none"])
            )
        wanted = bags.read_joints(path, reader, setpoint[0])
        tables = [
            _following(wanted, bags.read_joints(path, reader, topic)) for topic in measured_of
        ]
    return min(tables, key=lambda pair: pair[0])[1]


def _following(setpoint: bags.Joints, measured: bags.Joints) -> tuple[float, pd.DataFrame]:
    """Return how far measured joints are from a setpoint, and both at the times at which both are
    known.
    """
    begin, end = setpoint.time_ns[[0, -1]]
    common = (measured.time_ns >= begin) & (measured.time_ns <= end)
    time_ns, joints = measured.time_ns[common], measured.joints[common]
    desired = np.stack(
        [np.interp(time_ns - begin, setpoint.time_ns - begin, one) for one in setpoint.joints.T],
        axis=1,
    )
    return float(np.nanmean(np.abs(desired - joints))), _columns(time_ns, desired, joints)


def _columns(time_ns: np.ndarray, desired: np.ndarray, measured: np.ndarray) -> pd.DataFrame:
    columns = {"time_s": (time_ns - time_ns[:1]) * 1e-9}
    for joint, word in enumerate(JOINTS):
        columns |= {f"jpos_d_{word}": desired[:, joint], f"jpos_{word}": measured[:, joint]}
    return pd.DataFrame(columns).dropna(axis="columns", how="all")
