"""Fits the dynamics of models/psm/psm.xml to a recording of a real PSM (patient-side manipulator of
a da Vinci Research Kit), and predicts another recording.

    RAVENJAX_DATA=FOLDER python analysis/psm/identify.py           # print the tables
    RAVENJAX_DATA=FOLDER python analysis/psm/identify.py --write   # fit again, write psm.xml
    RAVENJAX_DATA=FOLDER python analysis/psm/identify.py FILE KG   # predict the effort of FILE

FOLDER contains two recordings of the public repository WPI-AIM/dvrk_dynamics_identification. The
model is fitted to dvrk_psm_no_load.parquet. Of dvrk_psm_105_g.parquet, with a weight at the arm,
only the position of this weight is fitted, on the first half. KG is the mass of another weight at
this position.

The source does not label the columns. Their meaning is inferred:

- 200 Hz: at this rate the derivative of the positions is the velocity within 0.5 %, for all joints.
  The script of the source commands and records at 200 Hz.
- Columns 5 to 7 are motors: their positions are multiples of the encoder count, 0.000134141 rad.
  The coupling of the instrument turns them into wrist pitch, wrist yaw and jaw.
- Gravity is along -z of frame 0, as in the source's script.

The efforts are linear in the masses of points on the links. The fit is non-negative least squares
with 27 points on each of the first three links, so that the inertia of each link is physically
possible. Each joint also has armature, viscous and dry friction, and the joints of the tool have a
spring with a rest position.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import os
import re
import sys
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from scipy.optimize import least_squares, nnls
from scipy.signal import butter, sosfiltfilt

ROOT = Path(__file__).parents[2]
FILE = ROOT / "models/psm/psm.xml"
DATA = Path(os.environ.get("RAVENJAX_DATA", ROOT.parent / "shared/data"))
JOINTS = ("yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw")
HZ, CUT_HZ = 200, 6.0
"""Rate of the recordings; low-pass, six times the highest frequency of the excitation."""
COUPLING = np.array([[1.0186, 0, 0], [-0.8306, 0.6089, 0.6089], [0, -1.2177, 1.2177]])
"""Wrist pitch, wrist yaw and jaw from the motors 5 to 7."""
SPAN = {"yaw": (0.3, 0.3, 0.3), "pitch": (0.5, 0.5, 0.5), "insertion": (0.1, 0.1, 0.4)}
"""Half the size of the box of points on each link, m."""
STILL = 0.02
"""Velocity at which dry friction is three quarters of its value, rad/s or m/s."""
RIDGE = 1e-4
"""Weight of small numbers in the fit, relative to that of an error as large as the effort."""
ARMATURE = 1e-4
"""Least armature of the tool's joints, kg m^2: the recording does not determine it (assumed)."""

LIGHT = 0.001
"""Least mass of a link, kg."""

Motion = tuple[np.ndarray, np.ndarray, np.ndarray]
Found = dict[str, dict[str, dict[str, str]]]
"""Attributes of the MJCF elements `inertial` and `joint`, by the name of the link."""


def read_columns(file: Path) -> tuple[Motion, np.ndarray]:
    """Return positions, velocities, accelerations and efforts, 5 to 7 those of motors [n, 7]."""
    table = pd.read_parquet(file).to_numpy()
    kept = slice(100, -100, 4)
    low = butter(4, CUT_HZ, fs=HZ, output="sos")
    qpos, effort = (sosfiltfilt(low, table[:, k : k + 7], axis=0) for k in (0, 14))
    qvel = np.gradient(qpos, 1 / HZ, axis=0)
    qacc = np.gradient(qvel, 1 / HZ, axis=0)
    return (qpos[kept], qvel[kept], qacc[kept]), effort[kept]


def read_recording(file: Path) -> tuple[Motion, np.ndarray]:
    """Return positions, velocities, accelerations and efforts of the six joints [n, 6]."""
    (qpos, qvel, qacc), effort = read_columns(file)
    for column in (qpos, qvel, qacc):
        column[:, 4:] = column[:, 4:] @ COUPLING.T
    effort[:, 4:] = effort[:, 4:] @ np.linalg.inv(COUPLING)
    return (qpos[:, :6], qvel[:, :6], qacc[:, :6]), effort[:, :6]


def inverse_dynamics(model: mujoco.MjModel, motion: Motion) -> np.ndarray:
    """Return the efforts that a model needs for a motion [n, 6]."""
    data, out = mujoco.MjData(model), np.empty(motion[0].shape)
    for row, (qpos, qvel, qacc) in enumerate(zip(*motion, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(model, data)
        out[row] = data.qfrc_inverse
    return out


def efforts_of_point(motion: Motion, link: str, point: np.ndarray) -> np.ndarray:
    """Return the efforts that 1 kg at a point of a link needs; the rest weighs nothing [n, 6]."""
    model = mujoco.MjModel.from_xml_path(str(FILE))
    for column in (model.body_mass, model.body_inertia, model.body_ipos, model.dof_armature):
        column[:] = 0.0
    body = model.body(link).id
    model.body_mass[body], model.body_ipos[body] = 1.0, point
    # Otherwise MuJoCo takes the short cuts of the model that was compiled.
    model.body_sameframe[:], model.body_simple[:] = 0, 0
    data, out = mujoco.MjData(model), np.empty(motion[0].shape)
    for row, (qpos, qvel, qacc) in enumerate(zip(*motion, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, out[row])
    return out


def fit(motion: Motion, effort: np.ndarray) -> Found:
    """Return what a least-squares fit finds."""
    names: list[tuple[str, Any]] = []
    columns: list[np.ndarray] = []
    for link, span in SPAN.items():
        for corner in product((-1, 0, 1), repeat=3):
            names.append((link, np.multiply(corner, span)))
            columns.append(efforts_of_point(motion, link, np.multiply(corner, span)))
    qpos, qvel, qacc = motion
    one, dry = np.ones_like(qpos), np.tanh(qvel / STILL)
    for place, joint in enumerate(JOINTS):
        shapes = {"armature": qacc, "damping": qvel, "frictionloss": dry}
        if joint not in SPAN:
            shapes |= {"up": one, "down": -one, "stiffness": qpos}
        for name, values in shapes.items():
            names.append((joint, name))
            columns.append(np.where(np.arange(6) == place, values, 0.0))
    size = np.sqrt(np.mean(effort**2, axis=0))
    matrix = (np.array(columns) / size).reshape(len(columns), -1).T
    small = np.sqrt(RIDGE * len(effort)) * np.eye(len(columns))
    found, _ = nnls(
        np.vstack([matrix, small]), np.r_[(effort / size).ravel(), np.zeros(len(columns))]
    )
    return {joint: _attributes(joint, names, found) for joint in JOINTS}


def _attributes(
    joint: str, names: list[tuple[str, Any]], found: np.ndarray
) -> dict[str, dict[str, str]]:
    own = [
        (name, number) for (link, name), number in zip(names, found, strict=True) if link == joint
    ]
    values = {name: number for name, number in own if isinstance(name, str)}
    body = {}
    if joint in SPAN:
        points = [(point, number) for point, number in own if not isinstance(point, str)]
        mass = sum(number for _, number in points)
        moments = [number * point for point, number in points]
        centre = np.sum(moments, axis=0) / max(mass, LIGHT)
        arms = [(point - centre, number) for point, number in points]
        inertia = sum(m * (arm @ arm * np.eye(3) - np.outer(arm, arm)) for arm, m in arms)
        # Points on one line have no inertia about it, and MuJoCo takes no link without mass.
        inertia = inertia + 1e-6 * np.eye(3)
        body = {
            "mass": _numbers([max(mass, LIGHT)]),
            "pos": _numbers(centre),
            "fullinertia": _numbers(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]),
        }
    else:
        rest = (values["down"] - values["up"]) / values["stiffness"]
        values |= {"armature": max(values["armature"], ARMATURE), "springref": rest}
    names_of_joint = ("armature", "damping", "frictionloss", "stiffness", "springref")
    return {
        "inertial": body,
        "joint": {name: _numbers([values[name]]) for name in names_of_joint if name in values},
    }


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{round(value, 6) + 0.0:.4g}" for value in values)


def write(found: Found) -> None:
    """Put the attributes into psm.xml; everything else stays."""
    text = FILE.read_text()
    for link, elements in found.items():
        start = text.index(f'<body name="{link}"')
        for element, attributes in elements.items():
            at = text.index(f"<{element}", start)
            end = text.index("/>", at)
            old = text[at:end]
            if attributes and element == "inertial":
                old = "<inertial"
            for name, value in attributes.items():
                old = re.sub(rf' {name}="[^"]*"', "", old) + f' {name}="{value}"'
            text = text[:at] + old + text[end:]
    FILE.write_text(text)


def relative(predicted: np.ndarray, effort: np.ndarray) -> np.ndarray:
    """Return the error, rms, divided by the effort, rms, of each joint."""
    return np.sqrt(np.mean((predicted - effort) ** 2, axis=0) / np.mean(effort**2, axis=0))


def place_of_weight(motion: Motion, missing: np.ndarray, link: str, mass: float) -> np.ndarray:
    """Return the point of a link at which a weight explains the missing efforts best, m."""
    size = np.sqrt(np.mean(missing[:, :3] ** 2, axis=0))

    def error(point: np.ndarray) -> np.ndarray:
        made = mass * efforts_of_point(motion, link, point)
        return ((made - missing)[:, :3] / size).ravel()

    return least_squares(error, np.zeros(3), diff_step=1e-3).x


def wrist_with_friction_at_motors(fitted: Path, judged: Path) -> np.ndarray:
    """Return the error for wrist pitch, wrist yaw and jaw, if friction, springs and constant forces
    belong to the motors 5 to 7 instead of the joints.
    """
    predicted = []
    for file in (fitted, judged):
        (qpos, qvel, _), effort = read_columns(file)
        errors = []
        for motor in range(4, 7):
            one = np.ones(len(qpos))
            laws = [qvel[:, motor], np.tanh(qvel[:, motor] / 0.1), qpos[:, motor], one, -one]
            if file == fitted:
                predicted.append(nnls(np.column_stack(laws), effort[:, motor])[0])
            errors.append(np.column_stack(laws) @ predicted[motor - 4])
        turn = np.linalg.inv(COUPLING)
        found = relative(np.column_stack(errors) @ turn, effort[:, 4:] @ turn)
    return found


def table(title: str, rows: dict[str, np.ndarray]) -> None:
    """Print errors in per cent of the effort as Markdown."""
    print(f"\n| {title} | {' | '.join(JOINTS)} |\n|{'---|' * 7}")
    for name, numbers in rows.items():
        print(f"| {name} | {' | '.join(f'{100 * x:.1f}' for x in numbers)} |")


def halves(motion: Motion) -> tuple[Motion, Motion]:
    """Return the first and the second half of a motion."""
    qpos, qvel, qacc = motion
    middle = len(qpos) // 2
    late = qpos[middle:], qvel[middle:], qacc[middle:]
    return (qpos[:middle], qvel[:middle], qacc[:middle]), late


def main(words: list[str]) -> None:
    """Print the tables of README.md."""
    first, effort = read_recording(DATA / "dvrk_psm_no_load.parquet")
    if words == ["--write"]:
        write(fit(first, effort))
    model = mujoco.MjModel.from_xml_path(str(FILE))
    second, heavier = read_recording(DATA / "dvrk_psm_105_g.parquet")
    predicted = inverse_dynamics(model, second)

    def nulls(motion: Motion, efforts: np.ndarray) -> dict[str, np.ndarray]:
        still = (motion[0], 0.0 * motion[1], 0.0 * motion[2])
        return {
            "null: zero effort": relative(0.0 * efforts, efforts),
            "null: mean effort of the first recording": relative(effort.mean(axis=0), efforts),
            "null: gravity and springs alone": relative(inverse_dynamics(model, still), efforts),
        }

    fitted = {"psm.xml": relative(inverse_dynamics(model, first), effort)}
    table("no load, fitted, error in % of the effort", fitted | nulls(first, effort))
    judged = {"psm.xml, without the weight": relative(predicted, heavier)} | nulls(second, heavier)
    judged["null: the first recording at the same time"] = relative(effort, heavier)
    table("105 g, not fitted, error in % of the effort", judged)

    motors = wrist_with_friction_at_motors(
        DATA / "dvrk_psm_no_load.parquet", DATA / "dvrk_psm_105_g.parquet"
    )
    numbers = ", ".join(f"{100 * x:.1f}" for x in motors)
    print(f"\n105 g, wrist pitch, wrist yaw and jaw with friction at the motors: {numbers} %")

    early, late = halves(second)
    middle, rows = len(early[0]), {"without": relative(predicted, heavier)}
    rows["without"] = relative(predicted[middle:], heavier[middle:])
    for link in ("pitch", "insertion"):
        point = place_of_weight(early, (heavier - predicted)[:middle], link, 0.105)
        weight = efforts_of_point(late, link, point)
        name = f"weight on the {link} link at {_numbers(point)} m"
        rows[name] = relative(predicted[middle:] + 0.105 * weight, heavier[middle:])
        if link == "pitch" and len(words) == 2:
            motion, efforts = read_recording(Path(words[0]))
            whole = inverse_dynamics(model, motion)
            loaded = whole + float(words[1]) * efforts_of_point(motion, link, point)
            other = {"without": relative(whole, efforts), name: relative(loaded, efforts)}
            table(f"{words[1]} kg, error in % of the effort", other | nulls(motion, efforts))
    table("105 g, second half, error in % of the effort", rows)


if __name__ == "__main__":
    main(sys.argv[1:])
