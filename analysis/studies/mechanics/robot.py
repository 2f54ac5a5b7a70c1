"""Is the virtual robot's mechanics a real one's? Statics, a recorded motor's load, and two arms'
following errors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from ravenjax.analyses.calibration import position_loop, tables
from ravenjax.analyses.calibration.calibrate import Calibration, LoggedRobot
from ravenjax.analyses.calibration.judgement import FollowingError
from ravenjax.analyses.calibration.parameters import unknowns
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import cables, parameter_sets, robot
from studies.dsn16.recording import closed_loop, horizons, prediction_tables
from studies.framework.study import Context, Findings, Line, Study, StudyEstimate, Table
from studies.mechanics import predictors, reaction, recordings, statics

OURS, AUTHORS = "power_consistent", "traj3"
BAND = (0.75, 1.25)
"""A following error within a quarter of the recorded one."""
FITTED = {recordings.THREE_JOINTS: (0, 1, 2), recordings.SEVEN_JOINTS: (3, 4, 5, 6)}
"""Joints whose friction and offsets are of which recording's first half."""
FITTED_KINDS = ("friction", "offsets")
ARMS = {recordings.THREE_JOINTS: "the authors' arm", recordings.SEVEN_JOINTS: "the arm of 2018"}


def compare(context: Context) -> Findings:
    """Lines of following errors, and the tables behind them."""
    from ravenjax.numbers.lazy import jax

    with jax.enable_x64(True):
        pressed = (statics.by_hand(), statics.of_robot(OURS), statics.of_robot(AUTHORS))
    lines: list[Line] = []
    every: dict[str, list[FollowingError]] = {}
    printed: list[Table] = [_statics(pressed)]
    ahead: tuple[str, ...] = ()
    paths = {name: path for name in FITTED if (path := closed_loop.locate(name)) is not None}
    if recordings.THREE_JOINTS in paths:
        with jax.enable_x64(True):
            log = closed_loop.read(paths[recordings.THREE_JOINTS])
            torque = reaction.held_out(log)
            printed += [_reaction(reaction.of_recording(log)), _held_out(torque)]
            ahead += (_load_note(torque),)
    for name, path in paths.items():
        read = (
            recordings.three_joints if name == recordings.THREE_JOINTS else recordings.seven_joints
        )
        logged = read(path)
        robots = {
            f"virtual robot, {one}": position_loop.params(robot.params(logged.setup, "gold", one))
            for one in (OURS, AUTHORS)
        }
        judged = logged.judged(logged.halves[1], robots)
        every[name] = judged
        lines += _lines(name, judged, logged.log.joints)
        title = f"Following error of {ARMS[name]} on the second half of {name}"
        printed.append(_table(tables.following(title, judged, logged.log.joints), _FOLLOWING))
        fitted = _fitted(logged, name)
        printed.append(
            _table(tables.parameters(f"Fitted to the first half of {name}", fitted), _PARAMETERS)
        )
    if recordings.SEVEN_JOINTS in paths:
        table, sentences = _predictions(recordings.seven_joints(paths[recordings.SEVEN_JOINTS]))
        printed.append(table)
        ahead += sentences
    missing = [name for name in FITTED if name not in paths]
    absent = (
        (f"Not at hand: {', '.join(missing)}. Set {recordings.DATA} to their folder.",)
        if missing
        else ()
    )
    return Findings(
        tuple(lines), tuple(printed), notes=(*absent, *_notes(lines, every), *ahead, *_NOTES)
    )


def _predictions(logged: LoggedRobot) -> tuple[Table, tuple[str, ...]]:
    """Of the seven joints beside null models, and what follows."""
    rows, period_ms = predictors.second_half(logged), recordings.SEVEN_PERIOD_MS
    part = predictors.stretch(logged, rows, period_ms)
    errors = horizons.compare(part, predictors.of(logged, rows, period_ms))
    title = (
        f"Predictions of {ARMS[recordings.SEVEN_JOINTS]} beside null models: mean and largest error"
    )
    return prediction_tables.table(title, part, errors), tuple(
        prediction_tables.sentences(part, errors)
    )


def _fitted(logged: LoggedRobot, name: str) -> Calibration:
    """The set's friction and offsets found anew, from the set itself."""
    return logged.calibrated(
        robot.params(logged.setup, "gold", OURS), unknowns(FITTED[name], FITTED_KINDS)
    )


def _lines(name: str, judged: Sequence[FollowingError], joints: Sequence[int]) -> Iterator[Line]:
    """The share of the recorded following error that the virtual robot has, joint by joint."""
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
            reason=_REASONS.get((name, j), ""),
        )


def _notes(
    lines: Sequence[Line], judged: Mapping[str, Sequence[FollowingError]]
) -> tuple[str, ...]:
    """How many joints are inside the band, also of the authors' law."""
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


def _statics(rows: Sequence[statics.Statics]) -> Table:
    columns = (
        "shoulder",
        "cable on the stop, N",
        "largest on the way, N",
        "joint, N m",
        "fastest motor, rad/s",
        f"gives way to {statics.LOAD_NM:g} N m, mm at 0.3 m",
    )
    cells = tuple(
        (one.who, *(_plain(x, d) for x, d in zip(one[1:], (0, 0, 1, 0, 2), strict=True)))
        for one in rows
    )
    note = (
        f"{statics.COUNTS} counts after the checks press the shoulder on its stop; the largest"
        " tension on the way depends on the assumed stiffness of the stop. A cable of this size"
        f" breaks at some {cables.POSITIONING_STRENGTH:.0f} N. Statics of speed: the supply of 48 V"
        " by the back EMF. The push of the last column meets a controller with KP of raven2."
    )
    return Table("What a sudden command and a push do", columns, cells, note)


def _plain(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _reaction(rows: Sequence[reaction.LoadShare]) -> Table:
    ours = parameter_sets.parameter_set(OURS)
    cells = tuple(
        (
            joint.replace("_", " "),
            _band([x * 1e4 for x in one.inertia]),
            f"{ours.motor_inertia[j] * 1e4:.2f}",
            _band(one.scale),
            f"{transmission.GP42:g}; 1",
            _agreement(one.scale),
            f"{100.0 * one.torque_share:.0f} %",
        )
        for j, (joint, one) in enumerate(zip(JOINTS, rows, strict=False))
    )
    columns = (
        "joint",
        "inertia, 1e-4 kg m2",
        "catalogue",
        "links' load, times",
        "statics; authors",
        "agrees with",
        "load's share of the torque",
    )
    note = (
        "Least squares on the recorded torque of the authors' arm while the joint moves, masses as"
        f" published; in brackets 95 % bands of a bootstrap over {reaction.STRETCHES} stretches. A"
        " load with the wrong sign means that what changes with the pose there is not the modelled"
        " weight: friction does, or the arm stood otherwise."
    )
    return Table("How much of the links' load a recorded motor carries", columns, cells, note)


def _held_out(rows: Sequence[reaction.TorqueError]) -> Table:
    cells = tuple(
        (
            one.model,
            *(f"{mean:.4f}, {most:.3f}" for mean, most in zip(one.mean, one.largest, strict=True)),
        )
        for one in rows
    )
    return Table(
        "Torque of a recorded motor, fitted to the first half and predicted on the second: mean and"
        " largest error, N m",
        ("model", *JOINTS[:3]),
        cells,
        "Rows as in the table before. A null model has no links; the load helps where a model with"
        " it errs less than the rotor with dry friction and offset. One recording is no sample, so"
        " there is no interval.",
    )


def _load_note(rows: Sequence[reaction.TorqueError]) -> str:
    """Where the load at the gear's ratio predicts better than the rotor alone, and than the load
    of the authors.
    """
    mean = {one.model: one.mean for one in rows}
    rotor, authors, statics_ = (mean[model] for model in reaction.COMPARED)
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
    """Which law's number is inside the band."""
    laws = {"statics": transmission.GP42, "authors": 1.0}
    inside = [law for law, number in laws.items() if scale[1] <= number <= scale[2]]
    return " and ".join(inside) if inside else "neither"


def _band(values: Sequence[float]) -> str:
    value, low, high = values
    return f"{value:.2f} ({low:.2f} to {high:.2f})"


def _table(rows: tables.Rows, note: str) -> Table:
    return Table(rows.title, rows.columns, tuple(rows.cells), note)


_FOLLOWING = (
    "Root mean square of measured minus desired joints. The virtual robots are asked for what the"
    " recorded one was asked for, from the beginning of the recording; in brackets their following"
    " error by the recorded one, then how far they are off the recording. Bare rotors are motors"
    " with viscous friction whose cables are all cut."
)
_PARAMETERS = (
    "Before: the set as it stands in the package, itself the rounded result of such a fit. Spread"
    " left: what the log leaves of what was believed before, by the curvature of the fit; a guide,"
    " since a real robot differs in more. How motor and joint share their dry friction is not"
    " asked: both move alike."
)
_REASONS = {
    (
        recordings.SEVEN_JOINTS,
        4,
    ): (
        "the recorded wrist lags more as its recording goes on, also at the same speed; no law that"
        " was tried reproduces both halves (docs/explanation/mechanics.md)"
    )
}
_NOTES = (
    (
        "The arm of 2018 strings its first jaw like its second, as the fork of 2015 does: with the"
        " jaw opposed, as in raven2 today, its virtual following error has nothing in common with"
        " the recorded one. Its tool joints have the integral of raven2's gains: recorded errors"
        " decay while the joint moves on."
    ),
    (
        "All errors are of motors, where the encoders are. Backlash and stretch behind them are not"
        " seen here."
    ),
)

STUDY = Study(
    name="mechanics",
    title="A power-consistent robot against two recorded arms",
    source=(
        "recordings of CSLDepend/raven2_sim (Li_DYN/dac_mvel_mpos.txt) and HaonanPeng/RAVEN_ILC"
        " (2018)"
    ),
    question=(
        "Do motors, gears, cables and friction of the virtual robot do what those of real ones did?"
    ),
    variants=(),
    compare=compare,
    minutes=12.0,
)
