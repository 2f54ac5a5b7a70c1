"""Reads a log of one robot arm: desired and measured joint positions in each control cycle.

A table (.csv, .parquet) has one row per sample. Names of columns end in the name of a joint, from
shoulder to grasp2. A log may leave joints out. A table needs one of these sets of columns; if it
has several, the first is used.

- `jpos_d_JOINT` and `jpos_JOINT`: desired and measured joint positions, rad or m.
- `mpos_d_JOINT` and `mpos_JOINT`: desired and measured motor angles, rad.
- `dac_JOINT`, `mpos_JOINT` and optionally `mvel_JOINT`: the desired joint positions are computed by
  inverting the robot's PD law. This works for joints without an integral term.

A name may end in `_deg` (motors and angles), `_deg_s` or `_mm` (insertion). The times are in a
column `time_s`, or in one with another unit. Without such a column, samples are `period_ms` apart.
If there is a column `runlevel`, only the longest stretch in run level pedal-down is used.

A bag of ROS 1 or 2 is converted to such a table. Joint positions come from one of these topics.

- raven2's `raven_2/raven_state`: `jpos` and `jpos_d` have eight numbers per arm, of which the
  fourth is unused. raven2 multiplies all of them by 180/pi, even the insertion.
- CRTK's `/arm1/measured_js` and `/arm1/setpoint_js` (arm1 is gold, arm2 green), rad and m. raven2
  publishes the measurements of each arm under the other arm's name (branch crtk,
  src/raven/local_io.cpp). This module therefore compares the measured positions of both arms with
  the desired positions of the arm, and uses the nearer ones.
"""

import dataclasses
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax import resources
from ravenjax.analyses.calibration.position_loop import Controller
from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, JOINTS, SLIDING_JOINTS, ArmName
from ravenjax.robots.raven2.geometry import limits, transmission
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages.motor_control import gravity_torques
from ravenjax.store import files
from ravenjax.store.logs import bags
from ravenjax.store.motion import source, stamps
from ravenjax.store.motion.options import Columns, ReplayOptions
from ravenjax.store.motion.resampling import true_stretches
from ravenjax.store.motion.source import Samples
from ravenjax.store.motion.summary import list_names

UNITS = {"deg_s": np.pi / 180.0, "deg": np.pi / 180.0, "mm": 1e-3, "": 1.0}
"""Factors to rad and m, by the end of a column's name."""
*HOLD, BEYOND = np.array([*resources.read_tables(__file__, "joint_log.toml").values()]) * [
    1.0 if joint in SLIDING_JOINTS else UNITS["deg"] for joint in JOINTS
]
"""Smallest and largest positions of the joints, and the accepted distance beyond; rad and m."""
SLOTS = np.array([0, 1, 2, 4, 5, 6, 7])
"""Positions of the joints in the eight numbers of an arm in raven_state. The fourth is unused."""
PER_STATE = np.pi / 180.0
"""rad and m per unit of raven_state."""


class JointLog(NamedTuple):
    """The log of one arm. Columns are the seven joints: rad, and m for the insertion."""

    start: np.ndarray  # [7], positions at the start of the log; NaN if missing
    desired: np.ndarray  # [T, 7], one row per control cycle (1 ms)
    measured: np.ndarray  # [n, 7], computed from the motor encoders; NaN if missing
    cycles: np.ndarray  # [n], cycle after which each row was measured
    notes: tuple[str, ...] = ()  # notes on how the log was read, for the user

    @property
    def joints(self) -> list[int]:
        """Return the joints (0 to 6) that the log has."""
        return np.flatnonzero(~np.isnan(self.measured).all(axis=0)).tolist()

    def compared(self, begin: int, end: int) -> "JointLog":
        """Return the log's cycles up to `end`, without the measurements before cycle `begin`.

        A replay simulates the cycles before `begin`, but is not compared with the log there.
        """
        rows = self.cycles < end
        measured = np.where((self.cycles >= begin)[:, None], self.measured, np.nan)
        return self._replace(
            desired=self.desired[:end], measured=measured[rows], cycles=self.cycles[rows]
        )


class LogOptions(ReplayOptions):
    """Options of the command line for reading a log."""

    def written(self, key: str, value: object) -> str:
        """Return how a user writes an option of the command `calibrate`; "" if there is none."""
        if key in ("sensors", "slow_down"):
            return ""
        if key == "rate_hz":
            return f"--period-ms {1e3 / float(str(value)):.6g}"
        shown = ",".join(value) if isinstance(value, list) else value
        return f"--{key.partition('.')[0]} {shown}"


def read_joint_log(
    path: Path,
    arm: ArmName,
    tool: str,
    software: str,
    controller: Controller,
    period_ms: float | None = None,
    columns: Columns | None = None,
    topics: str | None = None,
) -> JointLog:
    """Read the log of one arm.

    columns: as `ReplayOptions.columns`. topics: the arm's namespace in a bag. Raises UserError if
    the file or its columns have no supported form, or if a number or a time is not plausible.
    """
    if period_ms is not None and not period_ms > 0.0:
        raise UserError(f"--period-ms is {period_ms:g}, expected a number above 0")
    options = LogOptions(
        rate_hz=None if period_ms is None else 1e3 / period_ms,
        columns=[] if columns is None else columns,
        topics={} if topics is None else {arm: topics},
    )
    bag = path.exists() and bags.is_bag(path)
    if columns if bag else topics:
        unread, kind = ("columns", "table") if bag else ("topics", "bag")
        raise UserError(f"{path}: is no {kind}, and --{unread} needs a {kind}; remove --{unread}")
    if bag:
        samples = _read_bag(path, arm, options)
    elif path.is_file() and path.suffix in files.TABLES:
        samples = source.read_table(path, options, "time_s,jpos_d_shoulder,jpos_shoulder")
    else:
        kinds = ", ".join((*files.TABLES, *bags.SUFFIXES))
        raise UserError(f"{path}: expected a log ({kinds}) or the folder of a bag of ROS 2")
    pattern = rf"^([a-z]+(?:_d)?)_(?:{arm}_)?(.+?)((?:_deg_s|_deg|_mm)?)$"
    samples.table.columns = [
        re.sub(pattern, lambda x: f"{x[1]}_{bags.RAVEN2_NAMES.get(x[2], x[2])}{x[3]}", str(name))
        for name in samples.table
    ]
    files.require_distinct(path, samples.table)
    # A joint without any number is not logged.
    samples.table = samples.table.dropna(axis="columns", how="all")
    samples = _pedal_down(samples)
    times = _regular_times(samples, options)
    desired, measured = _joints(samples, times, arm, tool, software, controller)
    if unread := [name for name in samples.table if name not in samples.read]:
        samples.notes = (*samples.notes, f"columns not used: {list_names(unread)}")
    times = times - times[0]
    cycles = np.round(times * 1e3).astype(int)
    whole = np.arange(cycles[-1] + 1)
    on_clock = np.stack([np.interp(whole, times * 1e3, column) for column in desired.T], axis=1)
    # Encoders are read at the beginning of a cycle, so a row shows the result of the cycle before.
    return JointLog(measured[0], on_clock, measured[1:], cycles[1:] - 1, samples.notes)


def _pedal_down(samples: Samples) -> Samples:
    """Return the longest stretch of rows in pedal-down; all rows if the run level is not logged."""
    table, where = samples.table, ""
    if "runlevel" in table:
        stretches = true_stretches(samples.numbers("runlevel") == PEDAL_DOWN)
        # A stretch is (first row, row after the last).
        rows = slice(*max(stretches, key=lambda ends: ends[1] - ends[0], default=(0, 0)))
        times = None if samples.time_s is None else samples.time_s[rows]
        samples = dataclasses.replace(samples, table=table[rows], time_s=times)
        where = f" in pedal-down (runlevel {PEDAL_DOWN})"
    if len(samples.table) < 2:
        raise UserError(
            f"{samples.path} has {len(samples.table)} rows{where}; expected some seconds of motion"
        )
    return samples


def _regular_times(samples: Samples, options: ReplayOptions) -> np.ndarray:
    """Return the times of the samples [n], s. Raise UserError for implausible times or a gap."""
    # Without logged times, `times` requires a rate.
    if (times := samples.times(options)) is None:
        return np.arange(len(samples.table)) / (options.rate_hz or np.nan)
    path, clock = samples.path, samples.clock
    stamps.require_plausible(path, times, clock, options)
    for row, begin, end in stamps.find_gaps(times):
        if end - begin > options.max_gap_s:
            raise UserError(
                f"{path}: gap of {end - begin:.3f} s after {samples.place(row)} ({clock}); expected"
                f" at most {options.max_gap_s:g} s between samples. Cut the log there"
            )
    return times


def _joints(
    samples: Samples,
    times: np.ndarray,
    arm: ArmName,
    tool: str,
    software: str,
    controller: Controller,
) -> tuple[np.ndarray, np.ndarray]:
    """Return desired and measured joint positions [n, 7], rad and m. For a joint that is not
    logged, the desired position is its home and the measured one is NaN.
    """
    desired, measured = _quantity(samples, "jpos_d"), _quantity(samples, "jpos")
    if desired is None or measured is None:
        motors, targets = _quantity(samples, "mpos"), _quantity(samples, "mpos_d")
        counts = _quantity(samples, "dac")
        if motors is not None and targets is None and counts is not None:
            # The PD law is solved for the desired angle. An integral term would prevent this.
            speed = _quantity(samples, "mvel")
            speed = np.gradient(motors, times, axis=0) if speed is None else speed
            signs = np.array(transmission.tau_signs(arm, tool, software), float)
            torque = counts * signs / np.array(transmission.COUNTS_PER_NM)
            if software == "raven2":
                jpos = np.array(transmission.joint_from_motor(arm, tool, Vec(motors.T), software))
                known = np.where(np.isnan(jpos), np.array(limits.HOME_JPOS)[:, None], jpos)
                lift = gravity_torques(RavenSetup(software=software), arm, Vec(known))
                torque[:, :3] -= np.array(lift).T
            kp, kd, ki = np.array(controller[:3])
            targets = np.where(ki > 0.0, np.nan, motors + (torque + kd * speed) / kp)
        if motors is None or targets is None:
            raise UserError(
                f"{samples.path}: expected columns jpos_d_JOINT and jpos_JOINT, or mpos_d_JOINT and"
                " mpos_JOINT, or mpos_JOINT and dac_JOINT, such as mpos_shoulder; its columns are"
                f" {', '.join(map(str, samples.table.columns[:12]))}"
            )
        # If a motor is unknown, its joint and the following joints are unknown too.
        desired, measured = (
            np.stack(transmission.joint_from_motor(arm, tool, Vec(angles.T), software), axis=1)
            for angles in (targets, motors)
        )
    home, missing = np.array(limits.HOME_JPOS), np.isnan(desired)
    for name, joints in (("jpos_d", desired), ("jpos", measured)):
        _require_possible(samples, name, joints)
    unused = (missing & ~np.isnan(measured)).any(axis=0)
    if unused.any():
        names = ", ".join(JOINTS[joint] for joint in np.flatnonzero(unused))
        note = f"{names}: not used, because no desired position is logged"
        samples.notes = (*samples.notes, note)
    return np.where(missing, home, desired), np.where(missing, np.nan, measured)


def _require_possible(samples: Samples, name: str, joints: np.ndarray):
    """Raise UserError for joint positions [n, 7], rad and m, that no Raven-II can have. name:
    "jpos_d" or "jpos". The message names the unit that the values probably have. A position is
    impossible if it is beyond an end of the joint's range (HOLD) by more than BEYOND.
    """
    outside = (joints < HOLD[0] - BEYOND) | (joints > HOLD[1] + BEYOND)
    if not outside.any():
        return
    row, joint = np.argwhere(outside)[0]
    joint_name, value = JOINTS[joint], joints[row, joint]
    unit, other, factor = "rad", "deg", UNITS["deg"]
    if joint_name in SLIDING_JOINTS:
        unit, other, factor = "m", "mm", UNITS["mm"]
    low, high = (end[joint] for end in HOLD)
    column, advice = f"{name}_{joint_name}", ""
    # The end of a column's name tells its unit. Perhaps the numbers have the other unit. For
    # example, numbers in mm in column `jpos_insertion`, whose unit is m, belong in
    # `jpos_insertion_mm`, and 0.001 corrects them. The second alternative is the reverse mistake.
    alternatives = (
        (column, f"{column}_{other}", other, factor),
        (f"{column}_{other}", column, unit, 1 / factor),
    )
    for name_in_log, right_name, right_unit, correction in alternatives:
        converted = joints[:, joint] * correction
        inside = converted.min() >= low - BEYOND[joint] and converted.max() <= high + BEYOND[joint]
        if inside and name_in_log in samples.table:
            topic = samples.topic
            change = f"convert {topic}" if topic else f"name the column {right_name}"
            advice = f". If these are {right_unit.replace('deg', 'degrees')}, {change}"
    raise UserError(
        f"{samples.path}: {samples.place(row)}: {name} of {joint_name} is {value:.6g} {unit},"
        f" expected {low:.3g} to {high:.3g} {unit}{advice}"
    )


def _quantity(samples: Samples, name: str) -> np.ndarray | None:
    """Return the logged values of a quantity for each joint [n, 7], in rad and m. A joint that is
    not logged has NaN. The result is None if no joint is logged.
    """
    columns = np.full((len(samples.table), len(JOINTS)), np.nan)
    for joint, word in enumerate(JOINTS):
        if (numbers := samples.quantity(f"{name}_{word}", UNITS)) is not None:
            columns[:, joint] = numbers
    return None if np.isnan(columns).all() else columns


def _read_bag(path: Path, arm: ArmName, options: ReplayOptions) -> Samples:
    """Return a bag's columns jpos_d_JOINT and jpos_JOINT, and runlevel from raven_state."""
    with source.open_bag(path, options) as bag:
        for topic, kind in bag.kinds.items():
            if kind.endswith("/raven_state"):
                return _read_raven_state(path, arm, bag.read(topic))
        # raven2 publishes the measured joints of each arm under the name of the other arm, so the
        # topics of both arms are read.
        arms = (arm,) if options.topics else ARMS
        setpoint = bag.topic(arm, "setpoint_js")
        measured = [topic for name in arms if (topic := bag.topic(name, "measured_js"))]
        if setpoint is None or not measured:
            raise bag.missing(arm, "setpoint_js", "measured_js")
        setpoints, *candidates = map(bag.read, (setpoint, *measured))
    desired = bags.read_joints(path, setpoints)
    begin = setpoints.time_ns[0]
    # These samples serve only to check the times, so `desired` also stands for measured joints.
    times = _regular_times(_samples(path, setpoints, begin, desired, desired), options)
    distances, samples_of_candidate = [], []
    for messages in candidates:
        joints = bags.read_joints(path, messages)
        time_s = _regular_times(_samples(path, messages, begin, joints, joints), options)
        common = (time_s >= times[0]) & (time_s <= times[-1])
        desired_then = np.stack([np.interp(time_s, times, column) for column in desired.T], axis=1)
        samples = _samples(path, messages, begin, desired_then, joints)
        samples.table, samples.time_s = samples.table.loc[common], time_s[common]
        samples.notes = (*setpoints.notes, *samples.notes)
        distances.append(np.nanmean(np.abs(desired_then - joints)[common]))
        samples_of_candidate.append(samples)
    # The arm that received the desired positions is the one that stays closest to them.
    # A distance is NaN without common times.
    return samples_of_candidate[int(np.argmin(np.nan_to_num(distances, nan=np.inf)))]


def _read_raven_state(path: Path, arm: ArmName, states: bags.TopicMessages) -> Samples:
    # Returns the table of `_read_bag` from messages raven_state, which have 8 numbers for each arm.
    slots = SLOTS + 8 * ARMS.index(arm)
    desired, measured = (
        np.array([getattr(state, name)[slots] for state in states.messages], float) * PER_STATE
        for name in ("jpos_d", "jpos")
    )
    samples = _samples(path, states, states.time_ns[0], desired, measured)
    samples.table["runlevel"] = [int(state.runlevel) for state in states.messages]
    return samples


def _samples(
    path: Path,
    messages: bags.TopicMessages,
    begin_ns: np.int64,
    desired: np.ndarray,
    measured: np.ndarray,
) -> Samples:
    # Returns positions [T, joints], rad and m, as a table with columns jpos_d_NAME and jpos_NAME.
    names = [f"{name}_{word}" for name in ("jpos_d", "jpos") for word in JOINTS]
    table = pd.DataFrame(np.hstack([desired, measured]), columns=names, index=messages.number)
    time_s = (messages.time_ns - begin_ns) * 1e-9
    return Samples(path, table, messages.clock, time_s, messages.topic, messages.notes)
