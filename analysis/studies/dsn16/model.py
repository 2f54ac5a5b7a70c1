"""Study of the error of the dynamic model of DSN 2016, compared with a recorded robot in closed
loop (Figure 8 of the paper).
"""

import functools
from collections.abc import Callable, Mapping
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
AUTHORS, OURS = "traj3", "power_consistent"
"""Parameter sets compared with null models: the published set of A3, and the set of campaigns."""
SETS = (AUTHORS, "A", "B", "C", "D", "E", "matlab_main", "matlab_global", OURS)
HORIZONS_MS, EVERY_MS = (20, 50, 128), 200
"""Lengths of predictions, and time between their starts."""
NO_LOOP = "no loop"
LOOPS: dict[Rows, str] = {"asked": "closed loop", "dac": "open loop"}
"""Maps the input of the robot (its desired motion or the recorded DAC) to the kind of loop."""
HELD_POSITION, HELD_VELOCITY = "null model: constant position", "null model: constant velocity"
Ahead = Callable[[np.ndarray, int], np.ndarray]
"""Maps (starts [s], ms) to the joints in the ms after each start, [s, ms, 3] deg, deg, mm."""


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
        """Return the cells of a table, `0.112 (largest 0.53)`."""
        return [f"{mean:.3f} (largest {most:.2f})" for mean, most in zip(*self, strict=True)]


def error(asked: np.ndarray, log: JointRecording, parameter_set: str = AUTHORS) -> Error:
    """Return the errors of the virtual robot for desired motor angles `asked` (rad, [T, 3])."""
    run = recording.closed_loop(asked, log.angle[0], log.speed[0], parameter_set)
    return Error.of((run["mpos"][:-1, :3] - log.angle[1:]) * TO_JOINT)


def compare(context: study.Context) -> study.Findings:
    """Return the lines of A3, and the errors of predictions and of null models."""
    from scipy.signal import butter, sosfiltfilt

    path, notes = recording.locate(recording.FILE), study.read_notes(NAME)
    if path is None:
        place = f"set {recording.DATA} to the folder that holds {recording.FILE}"
        absent = f"the recording was not found: {place}"
        return study.Findings(tuple(_line(joint, None, absent) for joint in UNITS), notes=notes)
    whole = recording.read(path)
    log = recording.second_half(whole)
    low_pass = butter(2, LOW_PASS_HZ, fs=1000, output="sos")
    smooth = sosfiltfilt(low_pass, whole.angle, axis=0)[-len(log.angle) :]
    with jax.enable_x64(True):
        errors = {name: error(log.asked, log, name) for name in SETS}
        smoothed = error(smooth, log)
        found = predictions(log, robots(log) | held(log))
    rows = [
        (f"set {name}, desired motion of the recorded robot", *one.cells)
        for name, one in errors.items()
    ]
    words = f"recorded motion, low-passed at {LOW_PASS_HZ:g} Hz, as the desired motion"
    rows.append((f"set {AUTHORS}, {words}", *smoothed.cells))
    ahead = [
        (*model, horizon or "to the end", *one.cells) for (*model, horizon), one in found.items()
    ]
    n, of = len(log.angle) - 1, "ms of one recording"
    means = zip(UNITS, errors[AUTHORS].mean, strict=True)
    return study.Findings(
        tuple(_line(joint, StudyEstimate(float(mean), n=n, of=of)) for joint, mean in means),
        (read_table(NAME, "errors", rows), read_table(NAME, "predictions", ahead, every=EVERY_MS)),
        notes,
    )


def robots(log: JointRecording) -> dict[tuple[str, str], Ahead]:
    """Return the virtual robots and bare rotors in both loops. Needs 64-bit numbers."""
    sets = {name: robot.params(SETUP, ARM, name) for name in (OURS, AUTHORS)}
    # Parameters, and a factor on the stiffness and damping of every cable
    models = {f"virtual robot, {name}": (params, 1.0) for name, params in sets.items()}
    for name, params in sets.items():
        models[f"null model: bare rotors, {name}"] = position_loop.bare_rotors(params), 0.0

    @functools.partial(jax.jit, static_argnums=0)
    def run(rows: Rows, params: Any, cables: float, *begun: Any) -> Any:
        """Return motors [s, T, 7] of angles and speeds [s, 3] and inputs [s, T, 3]."""
        return jax.vmap(recording.loop(rows, params, cables))(*begun)[0]

    def predict(rows: Rows, model: tuple[Any, float], starts: np.ndarray, length: int) -> Any:
        inputs = log.asked if rows == "asked" else log.dac
        windows = np.stack([inputs[start : start + length] for start in starts])
        begun = map(jnp.asarray, (log.angle[starts], log.speed[starts], windows))
        return np.asarray(run(rows, *model, *begun))[:, :, :3] * TO_JOINT

    return {
        (loop, name): functools.partial(predict, rows, model)
        for rows, loop in LOOPS.items()
        for name, model in models.items()
    }


def held(log: JointRecording) -> dict[tuple[str, str], Ahead]:
    """Return the two null models that need no robot."""

    def hold(velocity: float, starts: np.ndarray, length: int) -> np.ndarray:
        seconds = np.arange(1, length + 1)[:, None] * 1e-3
        angle, speed = (part[starts, None] * TO_JOINT for part in (log.angle, log.speed))
        return angle + velocity * speed * seconds

    velocities = {HELD_POSITION: 0.0, HELD_VELOCITY: 1.0}
    return {(NO_LOOP, name): functools.partial(hold, of) for name, of in velocities.items()}


def predictions(
    log: JointRecording, models: Mapping[tuple[str, str], Ahead]
) -> dict[tuple[str, str, int | None], Error]:
    """Return the errors of models by loop, name and horizon (ms). Horizon None: one prediction
    from the beginning of the recording to its end.
    """
    angle, found = log.angle * TO_JOINT, {}
    starts = np.arange(0, len(angle) - max(HORIZONS_MS), EVERY_MS)
    for (loop, model), ahead in models.items():
        short = ahead(starts, max(HORIZONS_MS))
        for horizon in HORIZONS_MS:
            apart = short[:, horizon - 1] - angle[starts + horizon]
            found[loop, model, horizon] = Error.of(apart)
        whole = ahead(np.zeros(1, int), len(angle) - 1)[0]
        found[loop, model, None] = Error.of(whole - angle[1:])
    return found


def _line(joint: str, predicted: StudyEstimate | None, reason: str = "") -> Line:
    key, published = f"error.{joint}", Published(NAME)
    numbers = published.estimate(key), predicted, published.band(key)
    return Line(f"mean absolute joint error, {joint}", UNITS[joint], *numbers, "A3", reason)


STUDY = study.study(NAME, variants=(), compare=compare)
