"""Study: how large is the error of the dynamic model of DSN 2016, compared with a recorded robot in
closed loop (Figure 8 of the paper)?
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.analyses.calibration import position_loop
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.robots.raven2.plant import robot
from studies import study
from studies.dsn16 import recording
from studies.dsn16.recording import ARM, SETUP, TO_JOINT, UNITS, JointRecording, Rows
from studies.study import Line, Published, StudyEstimate, read_table

NAME = "dsn16_model"
LOW_PASS_HZ = 20.0
SETS = ("traj3", "A", "B", "C", "D", "E", "matlab_main", "matlab_global", "power_consistent")
AUTHORS = "traj3"
"""The published model to which these lines belong."""
PREDICTED_SETS = ("power_consistent", AUTHORS)
"""Parameter sets of the virtual robots that are compared with null models."""
HORIZONS_MS = (20, 50, 128)
EVERY_MS = 200
"""Time from one start to the next."""
CLOSED, OPEN, NO_LOOP = "closed loop", "open loop", "no loop"
"""Input of the robot: its desired motion, the recorded DAC, or none."""
LOOPS: dict[Rows, str] = {"asked": CLOSED, "dac": OPEN}
HELD_POSITION, HELD_VELOCITY = "null: hold the position", "null: hold the velocity"
ROTORS = "null: bare rotors"


class Error(NamedTuple):
    """Absolute errors at joints 1-3; deg, deg, mm."""

    mean: np.ndarray
    largest: np.ndarray

    @classmethod
    def of(cls, apart: np.ndarray) -> "Error":
        """Return the errors of differences [n, 3]."""
        return cls(np.abs(apart).mean(axis=0), np.abs(apart).max(axis=0))

    @property
    def cells(self) -> list[str]:
        """Return the cells of a table, `0.112, 0.53`."""
        return [f"{mean:.3f}, {most:.2f}" for mean, most in zip(*self, strict=True)]


Ahead = Callable[[np.ndarray, int], np.ndarray]
"""Maps (starts [s], ms) to the joints in the ms after each start, [s, ms, 3] deg, deg, mm."""


class Prediction(NamedTuple):
    """The errors of a robot, or of a null model, at one horizon."""

    loop: str
    model: str
    horizon_ms: int | None  # None: the whole recording, from its beginning
    error: Error

    @property
    def is_null(self) -> bool:
        """Return whether it is a null model's."""
        return self.model.startswith("null")


def error(asked: np.ndarray, log: JointRecording, parameter_set: str = AUTHORS) -> Error:
    """Return the errors of the virtual robot that is given desired motor angles `asked` (rad, [T,
    3]) from the beginning of `log`.
    """
    run = recording.closed_loop(asked, log.angle[0], log.speed[0], parameter_set)
    return Error.of((run["mpos"][:-1, :3] - log.angle[1:]) * TO_JOINT)


def compare(context: study.Context) -> study.Findings:
    """Return the lines of A3, which are the same for every set of parameters, and predictions
    compared with null models.
    """
    published = Published(NAME)
    path = recording.locate(recording.FILE)
    if path is None:
        absent = (
            f"the recording is not at hand: set {recording.DATA} to the folder that holds"
            f" {recording.FILE}"
        )
        lines = (_line(published, joint, None, absent) for joint in UNITS)
        return study.Findings(tuple(lines), notes=study.read_notes(NAME))
    whole = recording.read(path)
    log = recording.second_half(whole)
    smooth = _low_passed(whole.angle)[-len(log.angle) :]
    with jax.enable_x64(True):
        errors = {name: error(log.asked, log, name) for name in SETS}
        smoothed = error(smooth, log)
        found = predictions(log, robots(log) | held(log))
    rows = [
        (f"set {name}, asked for what the recorded robot was asked for", *one.cells)
        for name, one in errors.items()
    ]
    words = f"asked for the recording itself, low-passed at {LOW_PASS_HZ:g} Hz"
    rows.append((f"set {AUTHORS}, {words}", *smoothed.cells))
    ahead = [(one.loop, one.model, one.horizon_ms or "whole", *one.error.cells) for one in found]
    n, of = len(log.angle) - 1, "ms of one recording"
    means = zip(UNITS, errors[AUTHORS].mean, strict=True)
    return study.Findings(
        tuple(_line(published, joint, StudyEstimate(float(e), n=n, of=of)) for joint, e in means),
        (read_table(NAME, "errors", rows), read_table(NAME, "predictions", ahead, every=EVERY_MS)),
        (*_notes(published, errors[AUTHORS], found), *_sentences(found), *study.read_notes(NAME)),
    )


def robots(log: JointRecording) -> dict[tuple[str, str], Ahead]:
    """Return every virtual robot, and its rotors with every cable cut, in both loops. Needs 64-bit
    numbers.
    """
    sets = {name: robot.params(SETUP, ARM, name) for name in PREDICTED_SETS}
    # Parameters, and a factor on the stiffness and damping of every cable.
    models = {f"virtual robot, {name}": (params, 1.0) for name, params in sets.items()} | {
        f"{ROTORS}, {name}": (position_loop.bare_rotors(params), 0.0)
        for name, params in sets.items()
    }
    run = jax.jit(_motors, static_argnums=0)
    return {
        (loop, name): _robot(log, functools.partial(run, rows, *model), rows)
        for rows, loop in LOOPS.items()
        for name, model in models.items()
    }


def _motors(
    rows: Rows, params: robot.PlantParams, cables: float, angle: Any, speed: Any, inputs: Any
) -> Any:
    """Return motors [s, T, 7] of angles and speeds [s, 3] and inputs [s, T, 3]."""
    return jax.vmap(recording.loop(rows, params, cables))(angle, speed, inputs)[0]


def _robot(log: JointRecording, run: Callable[..., Any], rows: Rows) -> Ahead:
    inputs = log.asked if rows == "asked" else log.dac

    def ahead(starts: np.ndarray, length: int) -> np.ndarray:
        windows = np.stack([inputs[start : start + length] for start in starts])
        motors = run(*map(jnp.asarray, (log.angle[starts], log.speed[starts], windows)))
        return np.asarray(motors)[:, :, :3] * TO_JOINT

    return ahead


def held(log: JointRecording) -> dict[tuple[str, str], Ahead]:
    """Return the two null models that need no robot."""

    def holding(velocity: float) -> Ahead:
        def ahead(starts: np.ndarray, length: int) -> np.ndarray:
            seconds = np.arange(1, length + 1)[:, None] * 1e-3
            angle, speed = (part[starts, None] * TO_JOINT for part in (log.angle, log.speed))
            return angle + velocity * speed * seconds

        return ahead

    return {(NO_LOOP, HELD_POSITION): holding(0.0), (NO_LOOP, HELD_VELOCITY): holding(1.0)}


def predictions(log: JointRecording, models: dict[tuple[str, str], Ahead]) -> list[Prediction]:
    """Return the errors of models, by their loop and name, at every horizon and over the whole
    recording, whose rows are 1 ms apart.
    """
    angle, found = log.angle * TO_JOINT, []
    starts = np.arange(0, len(angle) - max(HORIZONS_MS), EVERY_MS)
    for (loop, model), ahead in models.items():
        short = ahead(starts, max(HORIZONS_MS))
        for horizon in HORIZONS_MS:
            apart = short[:, horizon - 1] - angle[starts + horizon]
            found.append(Prediction(loop, model, horizon, Error.of(apart)))
        whole = ahead(np.zeros(1, int), len(angle) - 1)[0]
        found.append(Prediction(loop, model, None, Error.of(whole - angle[1:])))
    return found


def _sentences(found: Sequence[Prediction]) -> Iterator[str]:
    """Say for each virtual robot in each loop where it predicts better than a held velocity, and
    than every null model.
    """
    robots = dict.fromkeys((one.loop, one.model) for one in found if not one.is_null)
    for loop, model in robots:
        where, best = [], 0
        for one in (one for one in found if (one.loop, one.model) == (loop, model)):
            nulls = {
                null.model: null.error.mean
                for null in found
                if null.is_null
                and null.horizon_ms == one.horizon_ms
                and null.loop in (loop, NO_LOOP)
            }
            ms = one.horizon_ms
            when = "over the whole" if ms is None else f"after {ms} ms"
            where.append(f"{when} at {_joints(one.error.mean < nulls[HELD_VELOCITY])}")
            best += int((one.error.mean < np.min(list(nulls.values()), axis=0)).sum())
        yield (
            f"{model[0].upper()}{model[1:]}, {loop}: its mean error is smaller than that of a held"
            f" velocity {'; '.join(where)}. It is smaller than that of every null model in {best}"
            f" of {len(where) * len(UNITS)} comparisons, one a joint and horizon."
        )


def _joints(better: np.ndarray) -> str:
    """Write `every joint`, `no joint`, or `2 of 3 joints (shoulder, elbow)`."""
    names = [joint for joint, is_better in zip(UNITS, better, strict=True) if is_better]
    if len(names) in (0, len(UNITS)):
        return "every joint" if names else "no joint"
    return f"{len(names)} of {len(UNITS)} joints ({', '.join(names)})"


def _notes(published: Published, robot: Error, found: Sequence[Prediction]) -> Iterator[str]:
    yield (
        f"Largest errors of the virtual robot, {AUTHORS}, in closed loop:"
        f" {_of_joints(robot.largest)}."
    )
    bands = [published.band(f"error.{joint}")[1] for joint in UNITS]
    passes = (
        "would meet A3, too: a controller makes any motor follow, and A3 does not tell whether the"
        " links are right"
    )
    for one in found:
        if one.loop == CLOSED and one.model.startswith(ROTORS) and one.horizon_ms is None:
            meets = (one.error.mean <= bands).all()
            yield (
                f"Bare rotors (motors of {one.model.rpartition(', ')[2]} with viscous friction,"
                f" every cable cut) have mean errors of {_of_joints(one.error.mean)} in the same"
                f" closed loop. They {passes if meets else 'would not meet A3'}."
            )


def _of_joints(values: np.ndarray) -> str:
    """Write `0.11 deg (shoulder), 0.08 deg (elbow), 0.29 mm (insertion)`."""
    return ", ".join(
        f"{value:.3f} {unit} ({joint})"
        for value, (joint, unit) in zip(values.tolist(), UNITS.items(), strict=True)
    )


def _line(
    published: Published, joint: str, predicted: StudyEstimate | None, reason: str = ""
) -> Line:
    key, name = f"error.{joint}", f"mean absolute error, {joint}"
    estimate, band = published.estimate(key), published.band(key)
    return Line(name, UNITS[joint], estimate, predicted, band, "A3", reason)


def _low_passed(angle: np.ndarray) -> np.ndarray:
    from scipy.signal import butter, sosfiltfilt

    return sosfiltfilt(butter(2, LOW_PASS_HZ, fs=1000, output="sos"), angle, axis=0)


STUDY = study.study(NAME, variants=(), compare=compare)
