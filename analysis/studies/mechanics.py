"""Study: does the virtual robot's mechanics resemble a real robot's?

It compares statics, a recorded motor's load, and the following errors of two arms. RAVENJAX_DATA
names the folder of the recordings.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.analyses.calibration import joint_log, position_loop, tables
from ravenjax.analyses.calibration.calibrate import Calibration, FollowingError, LoggedRobot
from ravenjax.analyses.calibration.parameters import select_unknowns
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import nominal, parameter_sets, robot
from ravenjax.robots.raven2.plant.coupling import N, arm_coupling
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stats.bootstrap.units import bootstrap
from studies.dsn16 import recording
from studies.dsn16.recording import ARM, TOOL, JointRecording, motors
from studies.study import (
    Context,
    Findings,
    Line,
    StudyEstimate,
    Table,
    read_notes,
    read_table,
    study,
)

THREE_JOINTS, SEVEN_JOINTS = recording.FILE, "recording_gold_7joints.parquet"
DATA = recording.DATA
SUPPLY_V = 48.0
SEVEN_PERIOD_MS = 4.94  # 8 144 rows in 40 s, received in bursts
LOG_SETUP = RavenSetup(software="fork2015", arms=("gold",), tools=("r_grasper",))
"""Setup for the recordings, also of the arm with seven joints. Unlike in today's raven2, that arm's
first jaw follows the insertion like its second.
"""


def three_joints(path: Path) -> LoggedRobot:
    """Return the log of the authors' arm in teleoperation, 21 s at 1 kHz. The desired joints are
    computed from its PD law.
    """
    log = joint_log.read_joint_log(
        path, "gold", LOG_SETUP.tools[0], LOG_SETUP.software, position_loop.FORK2015, period_ms=1.0
    )
    return LoggedRobot(log, LOG_SETUP, "gold", position_loop.FORK2015)


def seven_joints(path: Path) -> LoggedRobot:
    """Return the log of another arm, driven along circles by its own controller with today's gains,
    40 s.
    """
    log = joint_log.read_joint_log(
        path,
        "gold",
        LOG_SETUP.tools[0],
        LOG_SETUP.software,
        position_loop.RAVEN2,
        period_ms=SEVEN_PERIOD_MS,
    )
    return LoggedRobot(log, LOG_SETUP, "gold", position_loop.RAVEN2)


WINDOW_MS, ORDER = 41, 3  # settings of the Savitzky-Golay filter
MOVING_RAD_S = 1.0
STRETCHES = 20
"""Pieces of the recording, about a second each, that the bootstrap resamples."""


class LoadShare(NamedTuple):
    """One joint: estimates with their 95 % bands over stretches of the recording."""

    inertia: tuple[float, float, float]  # J, kg m2 in the equation's units: value, low, high
    scale: tuple[float, float, float]  # rho, 1
    # Standard deviation of the load's part of the torque divided by that of the torque.
    torque_share: float


class TorqueError(NamedTuple):
    """Absolute errors of a motor's torque on the second half of a recording, fitted to the first
    half; N m, [3] each.
    """

    model: str
    mean: np.ndarray
    largest: np.ndarray


class _Joint(NamedTuple):
    """Rows in which one joint moves."""

    columns: np.ndarray  # [n, 5] acceleration, load, speed, direction, 1
    torque: np.ndarray  # [n] N m
    place: np.ndarray  # [n] position in the recording, 0 to 1


MODELS: dict[str, tuple[tuple[int, ...], float]] = {
    "null: the first half's mean torque": ((4,), 0.0),
    "null: bare rotor, viscous friction": ((0, 2), 0.0),
    "rotor with dry friction and offset": ((0, 2, 3, 4), 0.0),
    "the same and the load, once (authors)": ((0, 2, 3, 4), 1.0),
    "the same and the load, 12.25 times (statics)": ((0, 2, 3, 4), transmission.GP42),
    "the same and the load, fitted": ((0, 1, 2, 3, 4), 0.0),
}
"""Columns that are fitted, and the factor of the load that is taken as given."""
COMPARED = tuple(MODELS)[2:5]
"""Models without the load, with the authors' load, and with the load of statics."""


def of_recording(log: JointRecording) -> list[LoadShare]:
    """Return load shares of shoulder, elbow and insertion. Needs 64-bit numbers."""
    return [
        _fit(joint.columns, joint.torque, (joint.place * STRETCHES).astype(int))
        for joint in _moving(log)
    ]


def held_out(log: JointRecording) -> list[TorqueError]:
    """Return how well each of MODELS, fitted to the first half, predicts the torque of the second.
    Needs 64-bit numbers.
    """
    joints = _moving(log)
    errors = []
    for model, (fitted, load) in MODELS.items():
        apart = [
            np.abs(_predicted(joint, fitted, load) - joint.torque[joint.place >= 0.5])
            for joint in joints
        ]
        mean, largest = (
            np.array([statistic(one) for one in apart]) for statistic in (np.mean, np.max)
        )
        errors.append(TorqueError(model, mean, largest))
    return errors


def _predicted(joint: _Joint, fitted: tuple[int, ...], load: float) -> np.ndarray:
    first, columns, fixed = joint.place < 0.5, joint.columns[:, fitted], load * joint.columns[:, 1]
    best, *_ = np.linalg.lstsq(columns[first], (joint.torque - fixed)[first], rcond=None)
    return columns[~first] @ best + fixed[~first]


def _moving(log: JointRecording) -> list[_Joint]:
    from scipy.signal import savgol_filter

    angle, speed, acceleration = (
        np.asarray(savgol_filter(log.angle, WINDOW_MS, ORDER, deriv=d, delta=1e-3, axis=0))
        for d in range(3)
    )
    torque = -np.asarray(savgol_filter(log.dac, WINDOW_MS, ORDER, axis=0)) / np.array(
        transmission.COUNTS_PER_NM[:3]
    )
    load = np.asarray(jax.jit(jax.vmap(_load))(*map(jnp.asarray, (angle, speed, acceleration))))
    inside = np.zeros(len(angle), bool)
    inside[WINDOW_MS:-WINDOW_MS] = True
    joints = []
    for j in range(3):
        rows = inside & (np.abs(speed[:, j]) > MOVING_RAD_S)
        columns = (
            acceleration[:, j],
            load[:, j],
            speed[:, j],
            np.sign(speed[:, j]),
            np.ones(len(angle)),
        )
        joints.append(
            _Joint(
                np.stack(columns, axis=1)[rows], torque[rows, j], np.flatnonzero(rows) / len(rows)
            )
        )
    return joints


def _load(angle: Any, speed: Any, acceleration: Any) -> jax.Array:
    """Return the torque (N m, motor coordinates) that rigid links require of motors 1-3, with
    unstretched cables; [3] each.
    """

    def joints(three: Any, still: bool) -> Vec:
        return transmission.joint_from_motor(
            ARM, TOOL, motors(three, still=still), recording.SETUP.software
        )

    jpos, jvel, jacc = joints(angle, False), joints(speed, True), joints(acceleration, True)
    gravity = Vec((-9.81, 0.0, 0.0))
    mass, bias = link_dynamics.mass_matrix_and_bias(recording.SETUP, ARM, jpos, jvel, gravity, 1.0)
    force = Vec(
        sum(mass[max(i, j)][min(i, j)] * jacc[j] for j in range(N)) + bias[i] for i in range(N)
    )
    return jnp.stack(arm_coupling(ARM, TOOL, recording.SETUP.software).carried(force)[:3])


def _fit(columns: np.ndarray, torque: np.ndarray, stretch: np.ndarray) -> LoadShare:
    pieces = [stretch == s for s in np.unique(stretch)]
    squares = np.array([columns[p].T @ columns[p] for p in pieces])
    products = np.array([columns[p].T @ torque[p] for p in pieces])

    def solved(rows: np.ndarray) -> np.ndarray:
        return np.linalg.solve(squares[rows].sum(axis=1), products[rows].sum(axis=1)[..., None])[
            ..., 0
        ]

    best = solved(np.arange(len(pieces))[None])[0]
    bands = [bootstrap(len(pieces), lambda rows, k=k: solved(rows)[:, k]) for k in (0, 1)]
    inertia, scale = (
        (float(best[k]), float(band.low), float(band.high)) for k, band in enumerate(bands)
    )
    return LoadShare(inertia, scale, float(np.std(best[1] * columns[:, 1]) / np.std(torque)))


STATICS_SETUP = RavenSetup(arms=("gold",), precision=REFERENCE)
COUNTS, LOAD_NM, TICKS = 10_000, 2.0, 1500
CAPSTAN_M, PULLEY_M = 5.675e-3, 63.095e-3  # of the shoulder: two_arm_dyn.cpp
KP = nominal.KP[0]  # N m per rad of motor, after the gearbox


class Statics(NamedTuple):
    """Statics of the shoulder."""

    who: str
    tension: float  # N, pressed against its stop by COUNTS
    peak: float  # N, on the way to the stop
    torque: float  # N m at the joint
    speed: float  # rad/s, largest of the motor
    # mm at 0.3 m of arm, pushed by LOAD_NM while its controller holds it.
    given_way: float


def of_robot(name: str) -> Statics:
    """Return the statics of the virtual robot with the set `name`. Needs 64-bit numbers."""
    params = robot.params(STATICS_SETUP, "gold", name)
    sign = transmission.tau_signs("gold", "r_grasper", "raven2")
    pressed = _run(params, int(-sign[0]) * COUNTS, 0.0, 0.0)
    pushed, rest = (_run(params, 0, KP, load) for load in (LOAD_NM, 0.0))
    tension = np.abs(pressed[0])
    return Statics(
        f"virtual robot, {name}",
        float(tension[-1]),
        float(tension.max()),
        float(tension[-1]) * PULLEY_M,
        float(np.abs(pressed[1]).max()),
        float(pushed[2][-1] - rest[2][-1]) * 300.0,
    )


def by_hand() -> Statics:
    """Return motor torque through gear and drum, speed at 48 V from the back EMF, and the
    controller's stiffness at the joint.
    """
    torque = COUNTS * transmission.TORQUE_PER_COUNT[0]
    ratio = transmission.TR[0]
    stiffness = KP * ratio**2 / transmission.GEARBOX[0]
    spring = 2.0 * parameter_sets.parameter_set("traj3").cable_stiffness[0] * PULLEY_M**2
    gives = LOAD_NM / stiffness + LOAD_NM / spring
    return Statics(
        "statics, without friction",
        torque / CAPSTAN_M,
        np.nan,
        torque * PULLEY_M / CAPSTAN_M,
        SUPPLY_V / transmission.TORQUE_PER_AMP[0],
        gives * 300.0,
    )


def _run(
    params: robot.PlantParams, counts: int, kp: float, load: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cable tension (N), motor speed (rad/s) and joint (rad) of the shoulder, [TICKS], with
    a spring at the motors.
    """
    drive = transmission.tau_signs("gold", "r_grasper", "raven2")
    state = robot.init(STATICS_SETUP, "gold", params, Vec(HOME_JPOS))
    state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
    start = robot.observe_robot(STATICS_SETUP, "gold", params, state).mpos
    push = Vec.full(7, 0.0).replace(0, load)

    def tick(state, _):
        angles = robot.observe_robot(STATICS_SETUP, "gold", params, state)
        torques = [
            kp * (a - b) - 0.027 * kp * v
            for a, b, v in zip(start, angles.mpos, angles.mvel, strict=True)
        ]
        spring = [
            torque * per_nm
            for torque, per_nm in zip(torques, transmission.COUNTS_PER_NM, strict=True)
        ]
        command = [
            int(s) * jnp.trunc(c).astype(jnp.int32) for s, c in zip(drive, spring, strict=True)
        ]
        command[0] = command[0] + counts
        signal = replace(robot.nominal_signal(Vec(command), jnp.int32(0)), external_torque=push)
        state, out = robot.step(STATICS_SETUP, "gold", params, state, signal)
        return state, (out.tension[0], out.mvel[0], out.jpos[0])

    _, rows = jax.jit(lambda one: jax.lax.scan(tick, one, None, length=TICKS))(state)
    tension, speed, jpos = map(np.asarray, rows)
    return tension, speed, jpos


NAME, OURS, AUTHORS = "mechanics", "power_consistent", "traj3"
WRIST = (
    "the recorded wrist lags more as its recording goes on, also at the same speed; no law that was"
    " tried reproduces both halves (docs/explanation/mechanics.md)"
)
BAND = (0.75, 1.25)
"""Band of agreement: a following error within a quarter of the recorded one."""
FITTED = {THREE_JOINTS: (0, 1, 2), SEVEN_JOINTS: (3, 4, 5, 6)}
"""Recording whose first half gives the friction and offsets of each joint."""
FITTED_KINDS = ("friction", "offsets")
ARMS = {THREE_JOINTS: "the authors' arm", SEVEN_JOINTS: "the arm of 2018"}


def compare(context: Context) -> Findings:
    """Return lines of following errors, and the tables behind them."""
    from ravenjax.numbers.lazy import jax

    with jax.enable_x64(True):
        pressed = (by_hand(), of_robot(OURS), of_robot(AUTHORS))
    lines: list[Line] = []
    every: dict[str, list[FollowingError]] = {}
    printed: list[Table] = [_statics(pressed)]
    ahead: tuple[str, ...] = ()
    paths = {name: path for name in FITTED if (path := recording.locate(name)) is not None}
    if THREE_JOINTS in paths:
        with jax.enable_x64(True):
            log = recording.read(paths[THREE_JOINTS])
            printed.append(_reaction(of_recording(log)))
            ahead = (_load_note(held_out(log)),)
    for name, path in paths.items():
        read = three_joints if name == THREE_JOINTS else seven_joints
        logged = read(path)
        robots = {
            f"virtual robot, {one}": position_loop.params(robot.params(logged.setup, "gold", one))
            for one in (OURS, AUTHORS)
        }
        judged = logged.judged(logged.halves[1], robots)
        every[name] = judged
        lines += _lines(name, judged, logged.log.joints)
        printed.append(_tabulate_following(judged, logged.log.joints, name))
        fitted = tables.tabulate_parameters("", _fitted(logged, name)).cells
        printed.append(read_table(NAME, "fitted", fitted, name=name))
    missing = [name for name in FITTED if name not in paths]
    absent = (f"Not at hand: {', '.join(missing)}. Set {DATA} to their folder.",) if missing else ()
    return Findings(
        tuple(lines),
        tuple(printed),
        notes=(*absent, *_notes(lines, every), *ahead, *read_notes(NAME)),
    )


def _fitted(logged: LoggedRobot, name: str) -> Calibration:
    return logged.calibrated(
        robot.params(logged.setup, "gold", OURS), select_unknowns(FITTED[name], FITTED_KINDS)
    )


def _lines(name: str, judged: Sequence[FollowingError], joints: Sequence[int]) -> Iterator[Line]:
    log, ours = judged[0].following, judged[1].following
    for j in joints:
        blind = "" if j in FITTED[name] else ", with the friction of the other"
        yield Line(
            f"following error of {JOINTS[j].replace('_', ' ')}, virtual by recorded:"
            f" {ARMS[name]}{blind}",
            "",
            StudyEstimate(1.0),
            StudyEstimate(float(ours[j] / log[j])),
            BAND,
            reason=WRIST if (name, j) == (SEVEN_JOINTS, 4) else "",
        )


def _notes(
    lines: Sequence[Line], judged: Mapping[str, Sequence[FollowingError]]
) -> tuple[str, ...]:
    if not lines:
        return ()
    authors = [
        bool(BAND[0] <= rows[2].following[j] / rows[0].following[j] <= BAND[1])
        for rows in judged.values()
        for j in range(3)
    ]
    return (
        (
            f"{sum(bool(line.passed) for line in lines)} of {len(lines)} joints have a following"
            " error within a quarter of the recorded one on the half of a recording that nothing"
            " was fitted to."
        ),
        (
            f"So do, with the authors' law, {sum(authors)} of {len(authors)} of joints 1-3: a"
            " controller makes either robot follow, and following does not tell the two laws"
            " apart. What the shoulder's motor carries does."
        ),
    )


def _statics(rows: Sequence[Statics]) -> Table:
    cells = (
        (one.who, *(_plain(x, d) for x, d in zip(one[1:], (0, 0, 1, 0, 2), strict=True)))
        for one in rows
    )
    strength = parameter_sets.parameter_set(OURS).cable_strength[0]
    return read_table(NAME, "statics", cells, strength=strength)


def _plain(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _reaction(rows: Sequence[LoadShare]) -> Table:
    ours = parameter_sets.parameter_set(OURS)
    cells = tuple(
        (
            joint.replace("_", " "),
            _band([x * 1e4 for x in one.inertia]),
            f"{ours.actuators.inertia[j] * 1e4:.2f}",
            _band(one.scale),
            f"{transmission.GP42:g}; 1",
            _agreement(one.scale),
            f"{100.0 * one.torque_share:.0f} %",
        )
        for j, (joint, one) in enumerate(zip(JOINTS, rows, strict=False))
    )
    return read_table(NAME, "load", cells)


def _load_note(rows: Sequence[TorqueError]) -> str:
    """Return where the load at the gear's ratio predicts better than the rotor alone, and than the
    authors' load.
    """
    mean = {one.model: one.mean for one in rows}
    rotor, authors, statics_ = (mean[model] for model in COMPARED)
    better = [
        " and ".join(
            joint
            for joint, mine, theirs in zip(JOINTS, statics_, other, strict=False)
            if mine < theirs
        )
        for other in (rotor, authors)
    ]
    return (
        "On the half that nothing was fitted to, the links' load at the gear's ratio predicts the"
        f" torque better than the rotor with friction alone at {better[0] or 'no joint'}, and"
        f" better than the authors' load at {better[1] or 'no joint'}."
    )


def _agreement(scale: Sequence[float]) -> str:
    laws = {"statics": transmission.GP42, "authors": 1.0}
    inside = [law for law, number in laws.items() if scale[1] <= number <= scale[2]]
    return " and ".join(inside) if inside else "neither"


def _band(values: Sequence[float]) -> str:
    value, low, high = values
    return f"{value:.2f} ({low:.2f} to {high:.2f})"


def _tabulate_following(rows: Sequence[FollowingError], joints: Sequence[int], name: str) -> Table:
    """Return a table of root mean square following errors of the log and of each model, with the
    model's ratio to the log's.
    """
    log, cells = rows[0].following, []
    for one in rows:
        line = [one.model]
        for j in joints:
            unit = tables.PER_UNIT[j]
            error = f"{one.following[j] * unit:.3f}"
            share = f" ({one.following[j] / log[j]:.2f}), off {one.residual[j] * unit:.3f}"
            line.append(error if one is rows[0] else error + share)
        cells.append(line)
    names = " | ".join(f"{JOINTS[j].replace('_', ' ')}, {tables.UNITS[j]}" for j in joints)
    return read_table(NAME, "following", cells, arm=ARMS[name], name=name, joints=names)


STUDY = study(NAME, variants=(), compare=compare)
