"""Study: how far is the dynamic model of DSN 2016 from a recorded robot in closed loop (its Figure
8)?
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from studies.dsn16 import recording
from studies.dsn16.recording import CLOSED, UNITS, HorizonError
from studies.study import (
    Context,
    Findings,
    Line,
    Published,
    StudyEstimate,
    Table,
    read_notes,
    study,
)

LOW_PASS_HZ = 20.0
SETS = ("traj3", "A", "B", "C", "D", "E", "matlab_main", "matlab_global", "power_consistent")
AUTHORS = "traj3"
"""The published model to which these lines belong."""


class Error(NamedTuple):
    """Absolute errors at joints 1-3; deg, deg, mm."""

    mean: np.ndarray
    largest: np.ndarray


def error(asked: np.ndarray, log: recording.JointRecording, parameter_set: str = AUTHORS) -> Error:
    """Return the errors of the virtual robot that is given desired motor angles `asked` (rad, [T,
    3]) from the beginning of `log`.
    """
    motors = recording.closed_loop(asked, log.angle[0], log.speed[0], parameter_set)["mpos"][
        :-1, :3
    ]
    apart = np.abs(motors - log.angle[1:]) * recording.TO_JOINT
    return Error(apart.mean(axis=0), apart.max(axis=0))


def compare(context: Context) -> Findings:
    """Return the lines of A3, which are the same for every set of parameters, and predictions
    compared with null models.
    """
    published = Published("dsn16_model")
    path = recording.find()
    if path is None:
        absent = (
            f"the recording is not at hand: set {recording.DATA} to the folder that holds"
            f" {recording.FILE}"
        )
        return Findings(
            tuple(_line(published, joint, None, absent) for joint in UNITS),
            notes=read_notes("dsn16_model"),
        )
    from ravenjax.numbers.lazy import jax

    whole = recording.read(path)
    log = recording.second_half(whole)
    smooth = _low_passed(whole.angle)[-len(log.angle) :]
    with jax.enable_x64(True):
        errors = {name: error(log.asked, log, name) for name in SETS}
        smoothed = error(smooth, log)
        part = recording.recorded_stretch(log)
        ahead = recording.horizon_errors(part, recording.predictors_of(log))
    lines = [
        _line(
            published,
            joint,
            StudyEstimate(float(mean), n=len(log.angle) - 1, of="ms of one recording"),
        )
        for joint, mean in zip(UNITS, errors[AUTHORS].mean, strict=True)
    ]
    rows = [
        (f"set {name}, asked for what the recorded robot was asked for", *_cells(e))
        for name, e in errors.items()
    ]
    rows.append(
        (
            f"set {AUTHORS}, asked for the recording itself, low-passed at {LOW_PASS_HZ:g} Hz",
            *_cells(smoothed),
        )
    )
    table = Table(
        "Mean and largest absolute error at the joint",
        ("plant and command", *(f"{joint}, {unit}" for joint, unit in UNITS.items())),
        tuple(rows),
        "On the second half of the recording, from its beginning, in closed loop. Friction and"
        " offsets of power_consistent are fitted to the first half; where the authors' sets were"
        " fitted is not published. One recording is no sample, so there is no interval.",
    )
    beside = recording.prediction_table(
        "Predictions beside null models: mean and largest error", part, ahead
    )
    sentences = (
        *_notes(published, errors[AUTHORS], ahead),
        *recording.prediction_sentences(part, ahead),
    )
    return Findings(tuple(lines), (table, beside), notes=(*sentences, *read_notes("dsn16_model")))


def _notes(published: Published, robot: Error, ahead: Sequence[HorizonError]) -> tuple[str, ...]:
    bands = [published.band(f"error.{joint}")[1] for joint in UNITS]
    rotors = [
        one
        for one in ahead
        if one.loop == CLOSED and one.model.startswith(recording.ROTORS) and one.horizon_ms is None
    ]
    passes = (
        "would meet A3, too: a controller makes any motor follow, and A3 does not tell whether the"
        " links are right"
    )
    sentences = (
        f"Bare rotors (motors of {one.model.rpartition(', ')[2]} with viscous friction, every cable"
        f" cut) have mean errors of {_of_joints(one.mean)} in the same closed loop. They"
        f" {passes if (one.mean <= bands).all() else 'would not meet A3'}."
        for one in rotors
    )
    return (
        (
            f"Largest errors of the virtual robot, {AUTHORS}, in closed loop:"
            f" {_of_joints(robot.largest)}."
        ),
        *sentences,
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
    key = f"error.{joint}"
    name = f"mean absolute error, {joint}"
    return Line(
        name, UNITS[joint], published.estimate(key), predicted, published.band(key), "A3", reason
    )


def _cells(one: Error) -> tuple[str, ...]:
    return tuple(
        f"{mean:.3f}, {most:.2f}" for mean, most in zip(one.mean, one.largest, strict=True)
    )


def _low_passed(angle: np.ndarray) -> np.ndarray:
    from scipy.signal import butter, sosfiltfilt

    return sosfiltfilt(butter(2, LOW_PASS_HZ, fs=1000, output="sos"), angle, axis=0)


STUDY = study("dsn16_model", variants=(), compare=compare)
