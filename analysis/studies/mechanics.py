"""Study: do the mechanics of the virtual robot agree with those of real robots? It compares
statics, the load on a recorded motor, and the following errors of two arms.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.analyses.calibration import joint_log, position_loop, tables
from ravenjax.analyses.calibration.calibrate import FollowingError, LoggedRobot
from ravenjax.analyses.calibration.parameters import select_unknowns
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.original import constants
from ravenjax.robots.raven2.plant import parameter_sets, robot
from ravenjax.robots.raven2.plant.coupling import N, arm_coupling
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stats.units import bootstrap
from studies import study
from studies.dsn16 import recording
from studies.dsn16.recording import ARM, DATA, TOOL, JointRecording, motors
from studies.study import read_table

NAME, OURS, AUTHORS = "mechanics", "power_consistent", "traj3"
THREE_JOINTS, SEVEN_JOINTS = recording.FILE, "recording_gold_7joints.parquet"
SUPPLY_V = 48.0
SEVEN_PERIOD_MS = 4.94  # 8 144 rows in 40 s, received in bursts
LOG_SETUP = RavenSetup(software="fork2015", arms=("gold",), tools=("r_grasper",))
"""Setup for both recordings. In the recording with seven joints, too, the motors of both jaws have
the same sign.
"""
WRIST = (
    "the recorded following error of the wrist grows with time at equal speed; no friction law that"
    " was tried reproduces both halves (docs/explanation/mechanics.md)"
)
BAND = (0.75, 1.25)
"""Acceptance band of the following error, relative to the recorded one."""
ARMS, MODELS = study.read_toml(f"published/{NAME}.toml").values()
"""Recorded arms by the file of the recording, and models of the torque of a motor."""
COMPARED = tuple(MODELS)[2:5]
"""Models without the load, with that of the published law, and with that of statics."""


def logged(name: str, path: Path) -> LoggedRobot:
    """Return a log: teleoperation of the DSN 2016 authors' arm, 21 s at 1 kHz, or 40 s of another
    arm on circles, with the gains of raven2.
    """
    authors = name == THREE_JOINTS
    controller = position_loop.FORK2015 if authors else position_loop.RAVEN2
    kind = "gold", LOG_SETUP.tools[0], LOG_SETUP.software, controller
    period_ms = 1.0 if authors else SEVEN_PERIOD_MS
    log = joint_log.read_joint_log(path, *kind, period_ms=period_ms)
    return LoggedRobot(log, LOG_SETUP, "gold", controller)


# --- load of the links on a recorded motor ---

WINDOW_MS, ORDER, MOVING_RAD_S = 41, 3, 1.0  # Savitzky-Golay filter; slowest rows
STRETCHES = 20
"""Stretches of the recording, about 1 s each, that the bootstrap resamples."""


class LoadShare(NamedTuple):
    """Estimates of one joint with 95 % intervals over stretches of the recording."""

    inertia: tuple[float, float, float]  # kg m2 in the units of the equation: value, low, high
    scale: tuple[float, float, float]  # load relative to the published law
    # Standard deviation of the load divided by that of the torque
    torque_share: float


class _Joint(NamedTuple):
    """Rows in which one joint moves."""

    columns: np.ndarray  # [n, 5] acceleration, load, speed, direction, 1
    torque: np.ndarray  # [n] N m
    place: np.ndarray  # [n] position in the recording, 0 to 1


def of_recording(log: JointRecording) -> list[LoadShare]:
    """Return load shares of shoulder, elbow and insertion. Needs 64-bit numbers."""
    return [*map(_load_share, _moving(log))]


def _load_share(joint: _Joint) -> LoadShare:
    columns, torque, stretch = joint.columns, joint.torque, (joint.place * STRETCHES).astype(int)
    pieces = [stretch == s for s in np.unique(stretch)]
    squares = np.array([columns[p].T @ columns[p] for p in pieces])
    products = np.array([columns[p].T @ torque[p] for p in pieces])[..., None]

    def solved(rows: np.ndarray) -> np.ndarray:
        return np.linalg.solve(squares[rows].sum(axis=1), products[rows].sum(axis=1))[..., 0]

    best = solved(np.arange(len(pieces))[None])[0]
    bands = [bootstrap(len(pieces), lambda rows, k=k: solved(rows)[:, k]) for k in (0, 1)]
    inertia, scale = (
        (float(best[k]), float(band.low), float(band.high)) for k, band in enumerate(bands)
    )
    return LoadShare(inertia, scale, float(np.std(best[1] * columns[:, 1]) / np.std(torque)))


def held_out(log: JointRecording) -> dict[str, list[np.ndarray]]:
    """Return errors (N m, [n] for each joint) on the second half of MODELS fitted to the first."""
    errors: dict[str, list[np.ndarray]] = {model: [] for model in MODELS}
    for joint in _moving(log):
        first = joint.place < 0.5
        for model, row in MODELS.items():
            columns = joint.columns[:, row["fitted"]]
            rest = joint.torque - row["load"] * joint.columns[:, 1]
            best, *_ = np.linalg.lstsq(columns[first], rest[first], rcond=None)
            errors[model].append(np.abs(columns[~first] @ best - rest[~first]))
    return errors


def _moving(log: JointRecording) -> Iterator[_Joint]:
    from scipy.signal import savgol_filter

    def smooth(values: np.ndarray, derivative: int = 0) -> np.ndarray:
        smoothed = savgol_filter(values, WINDOW_MS, ORDER, deriv=derivative, delta=1e-3, axis=0)
        return np.asarray(smoothed)

    angle, speed, acceleration = (smooth(log.angle, d) for d in range(3))
    torque = -smooth(log.dac) / np.array(transmission.COUNTS_PER_NM[:3])
    load = np.asarray(jax.jit(jax.vmap(_load))(*map(jnp.asarray, (angle, speed, acceleration))))
    parts = acceleration, load, speed, np.sign(speed), np.ones_like(speed)
    columns = np.stack(parts, axis=-1)
    inside = np.zeros(len(angle), bool)
    inside[WINDOW_MS:-WINDOW_MS] = True
    for j in range(3):
        rows = inside & (np.abs(speed[:, j]) > MOVING_RAD_S)
        yield _Joint(columns[rows, j], torque[rows, j], np.flatnonzero(rows) / len(rows))


def _load(angle: Any, speed: Any, acceleration: Any) -> jax.Array:
    """Return the torque (N m, [3]) at motors 1-3 that rigid links on rigid cables require."""
    software = recording.SETUP.software

    def joints(three: Any, still: bool) -> Vec:
        return transmission.joint_from_motor(ARM, TOOL, motors(three, still=still), software)

    jpos, jvel, jacc = joints(angle, False), joints(speed, True), joints(acceleration, True)
    gravity = Vec((-9.81, 0.0, 0.0))
    mass, bias = link_dynamics.mass_matrix_and_bias(ARM, jpos, jvel, gravity, 1.0)
    force = Vec(
        sum(mass[max(i, j)][min(i, j)] * jacc[j] for j in range(N)) + bias[i] for i in range(N)
    )
    return jnp.stack(arm_coupling(ARM, TOOL, software).motor_torques(force)[:3])


# --- statics of the shoulder ---

STATICS_SETUP = RavenSetup(arms=("gold",), precision=REFERENCE)
COUNTS, LOAD_NM, TICKS = 10_000, 2.0, 1500
CAPSTAN_M, PULLEY_M = 5.675e-3, 63.095e-3  # of the shoulder: two_arm_dyn.cpp
KP = constants.GAINS["raven2"]["gold"]["kp"][0]  # N m per rad of motor, after the gearbox


class Statics(NamedTuple):
    who: str
    tension: float  # N, of the cable, pressed against the stop by COUNTS
    peak: float  # N, of the cable on the way to the stop
    torque: float  # N m at the joint
    speed: float  # rad/s, largest of the motor
    given_way: float  # mm at 0.3 m, displacement by LOAD_NM while the controller holds

    @property
    def cells(self) -> tuple[str, ...]:
        digits = zip(self[1:], (0, 0, 1, 0, 2), strict=True)
        return self.who, *("" if math.isnan(value) else f"{value:.{n}f}" for value, n in digits)


def of_robot(name: str) -> Statics:
    """Return the statics of the virtual robot with the set `name`. Needs 64-bit numbers."""
    params = robot.params(STATICS_SETUP, "gold", name)
    sign = transmission.tau_signs("gold", "r_grasper", "raven2")
    pressed = _run(params, int(-sign[0]) * COUNTS, 0.0, 0.0)
    pushed, rest = (_run(params, 0, KP, load) for load in (LOAD_NM, 0.0))
    tension, speed = np.abs(pressed[0]), np.abs(pressed[1])
    held, given = float(tension[-1]), float(pushed[2][-1] - rest[2][-1]) * 300.0
    peak, torque = float(tension.max()), held * PULLEY_M
    return Statics(f"virtual robot, {name}", held, peak, torque, float(speed.max()), given)


def by_hand() -> Statics:
    """Return statics: torque through gear and drum, speed from back EMF, stiffness from KP."""
    torque = COUNTS * transmission.TORQUE_PER_COUNT[0]
    stiffness = KP * transmission.TR[0] ** 2 / transmission.GEARBOX[0]
    spring = 2.0 * parameter_sets.parameter_set(AUTHORS).cable_stiffness[0] * PULLEY_M**2
    given = (LOAD_NM / stiffness + LOAD_NM / spring) * 300.0
    speed, tension = SUPPLY_V / transmission.TORQUE_PER_AMP[0], torque / CAPSTAN_M
    joint = torque * PULLEY_M / CAPSTAN_M
    return Statics("statics, without friction", tension, np.nan, joint, speed, given)


def _run(
    params: robot.PlantParams, counts: int, kp: float, load: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cable tension (N), motor speed (rad/s), joint (rad) of the shoulder, [TICKS] each."""
    drive = transmission.tau_signs("gold", "r_grasper", "raven2")
    state = robot.init(STATICS_SETUP, "gold", params, Vec(HOME_JPOS))
    state = replace(state, brakes=replace(state.brakes, engaged=jnp.int32(0)))
    start = robot.observe_robot(STATICS_SETUP, "gold", params, state).mpos
    push = Vec.full(7, 0.0).replace(0, load)

    def tick(state, _):
        angles = robot.observe_robot(STATICS_SETUP, "gold", params, state)
        scales = drive, transmission.COUNTS_PER_NM
        command = [
            int(sign) * jnp.trunc((kp * (a - b) - 0.027 * kp * v) * per_nm).astype(jnp.int32)
            for a, b, v, sign, per_nm in zip(start, angles.mpos, angles.mvel, *scales, strict=True)
        ]
        command[0] = command[0] + counts
        signal = replace(robot.PlantSignal(Vec(command), jnp.int32(0)), external_torque=push)
        state, out = robot.step(STATICS_SETUP, "gold", params, state, signal)
        return state, (out.tension[0], out.mvel[0], out.jpos[0])

    _, rows = jax.jit(lambda state: jax.lax.scan(tick, state, None, length=TICKS))(state)
    tension, speed, jpos = map(np.asarray, rows)
    return tension, speed, jpos


# --- findings ---


def compare(context: study.Context) -> study.Findings:
    """Return lines of following errors, and the tables behind them."""
    paths = {name: path for name in ARMS if (path := recording.locate(name)) is not None}
    missing = [name for name in ARMS if name not in paths]
    absent = (f"Not found: {', '.join(missing)}. Set {DATA} to their folder.",) if missing else ()
    load = ()
    with jax.enable_x64(True):
        statics = [one.cells for one in (by_hand(), of_robot(OURS), of_robot(AUTHORS))]
        strength = parameter_sets.parameter_set(OURS).cable_strength[0]
        printed = [read_table(NAME, "statics", statics, strength=strength)]
        if THREE_JOINTS in paths:
            log = recording.read(paths[THREE_JOINTS])
            printed.append(read_table(NAME, "load", _load_rows(of_recording(log))))
            load = _load_note(held_out(log))
    lines: list[study.Line] = []
    # Whether joints 1-3 with the published law are inside BAND
    authors: list[bool] = []
    for name, path in paths.items():
        log, arm = logged(name, path), ARMS[name]
        sets = {law: robot.params(log.setup, "gold", law) for law in (OURS, AUTHORS)}
        robots = {f"virtual robot, {law}": position_loop.params(sets[law]) for law in sets}
        rows = log.following_errors(log.halves[1], robots)
        ours, theirs = (row.following / rows[0].following for row in rows[1:3])
        authors += [bool(BAND[0] <= ratio <= BAND[1]) for ratio in theirs[:3]]
        for j in log.log.joints:
            blind = "" if j in arm["fitted"] else ", with the friction of the other arm"
            words = f"ratio of virtual to recorded: {arm['words']}{blind}"
            reason = WRIST if (name, j) == (SEVEN_JOINTS, 4) else ""
            ratios = study.StudyEstimate(1.0), study.StudyEstimate(float(ours[j]))
            quantity = f"following error of {JOINTS[j].replace('_', ' ')}, {words}"
            lines.append(study.Line(quantity, "", *ratios, BAND, reason=reason))
        unknowns = select_unknowns(arm["fitted"], ("friction", "offsets"))
        fit = log.calibrated(sets[OURS], unknowns)
        fitted = tables.tabulate_parameters(fit)
        printed.append(_following(rows, log.log.joints, name))
        printed.append(read_table(NAME, "fitted", fitted, name=name))
    numbers = {"ours": sum(bool(line.passed) for line in lines), "joints": len(lines)}
    numbers |= {"authors": sum(authors), "of": len(authors)}
    followed = study.read_notes("mechanics_following", **numbers) if lines else ()
    notes = (*absent, *followed, *load, *study.read_notes(NAME))
    return study.Findings(tuple(lines), tuple(printed), notes)


def _following(rows: Sequence[FollowingError], joints: Sequence[int], name: str) -> study.Table:
    """Return following errors of the log and of each model, and their ratio to the log's."""
    (_, *models), by_joint = tables.by_joint(rows, joints)
    names, *by_model = zip(*by_joint, strict=True)
    cells = [[cell.replace("\n", ", ") for cell in errors] for errors in by_model]
    found = ([model, *row] for model, row in zip(models, cells, strict=True))
    words = {"arm": ARMS[name]["words"], "name": name, "joints": " | ".join(names)}
    return read_table(NAME, "following", found, **words)


def _load_rows(found: Sequence[LoadShare]) -> Iterator[tuple[str, ...]]:
    catalogue = parameter_sets.parameter_set(OURS).actuators.inertia
    laws = {"statics": transmission.GP42, "published law": 1.0}
    for j, joint in enumerate(found):
        _, low, high = joint.scale
        inside = [law for law, number in laws.items() if low <= number <= high]
        yield (
            JOINTS[j].replace("_", " "),
            _band(x * 1e4 for x in joint.inertia),
            f"{catalogue[j] * 1e4:.2f}",
            _band(joint.scale),
            f"{transmission.GP42:g}; 1",
            " and ".join(inside) or "neither",
            f"{100.0 * joint.torque_share:.0f} %",
        )


def _band(values: Iterator[float] | Sequence[float]) -> str:
    value, low, high = values
    return f"{value:.2f} ({low:.2f} to {high:.2f})"


def _load_note(errors: Mapping[str, Sequence[np.ndarray]]) -> tuple[str, ...]:
    """Return where the load of statics predicts better than no load, and than the published."""
    rotor, authors, statics = (list(map(np.mean, errors[model])) for model in COMPARED)
    rotor, authors = (
        " and ".join(JOINTS[j] for j in range(3) if statics[j] < other[j]) or "no joint"
        for other in (rotor, authors)
    )
    return study.read_notes("mechanics_load", rotor=rotor, authors=authors)


STUDY = study.study(NAME, (), compare)
