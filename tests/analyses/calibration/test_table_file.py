"""Logs as tables: what the columns mean, and what is refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ravenjax.analyses.calibration import joint_log, position_loop
from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.geometry import transmission

ARM, TOOL, SOFTWARE = "gold", "r_grasper", "fork2015"
MOTORS = (68.0, 191.0, 898.0)
"""Of the first three joints, rad."""


def read(path: Path, period_ms: float | None = 2.0):
    return joint_log.read_joint_log(path, ARM, TOOL, SOFTWARE, position_loop.FORK2015, period_ms)


def joints(rows: int = 5) -> np.ndarray:
    change = np.linspace(0.1, 0.4, rows)[:, None] * np.array([1.0, 3.0, 0.1, 0.5, 0.5, 0.2, 0.2])
    return np.array([0.0, 0.0, 0.35, 0.0, 0.0, 0.0, 0.0]) + change


def write(folder: Path, name: str = "log.csv", **columns) -> Path:
    table = pd.DataFrame(columns)
    path = folder / name
    table.to_csv(path, index=False) if name.endswith(".csv") else table.to_parquet(path)
    return path


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_joints_are_put_on_the_clock_of_the_control_cycle(tmp_path, name) -> None:
    values = joints()
    columns = {f"jpos_{word}": values[:, j] for j, word in enumerate(JOINTS)}
    columns |= {f"jpos_d_{word}": values[:, j] + 0.01 for j, word in enumerate(JOINTS)}
    log = read(write(tmp_path, name, **columns))
    assert log.desired.shape == (9, 7) and log.cycles.tolist() == [1, 3, 5, 7]
    np.testing.assert_allclose(log.desired[::2], values + 0.01)
    np.testing.assert_allclose(log.desired[1], (values[0] + values[1]) / 2 + 0.01)
    np.testing.assert_allclose(log.measured, values[1:])
    np.testing.assert_allclose(log.start, values[0])


def test_joints_may_have_the_names_of_raven2_and_columns_without_use_are_named(tmp_path) -> None:
    values, names = joints(), ("gold_shoulder", "elbow", "ins", "roll", "wrist", "jaw1", "jaw2")
    columns = {f"{kind}_{word}": values[:, j] for kind in DESIRED for j, word in enumerate(names)}
    log = read(write(tmp_path, **columns, jpos_green_elbow=values[:, 0], force=values[:, 0]))
    np.testing.assert_allclose(log.measured, values[1:])
    assert log.notes == ("columns not used: jpos_green_elbow, force",)
    with pytest.raises(UserError, match="--topics needs a bag"):
        joint_log.read_joint_log(
            tmp_path / "log.csv", ARM, TOOL, SOFTWARE, position_loop.FORK2015, topics="/lab"
        )


def test_motors_in_degrees_become_joints(tmp_path) -> None:
    values = joints()
    motors = np.array(
        [
            [float(m) for m in transmission.motor_from_joint(ARM, TOOL, Vec(q), None, SOFTWARE)]
            for q in values
        ]
    )
    columns = {f"mpos_{word}_deg": np.degrees(motors[:, j]) for j, word in enumerate(JOINTS)}
    columns |= {f"mpos_d_{word}_deg": np.degrees(motors[:, j]) for j, word in enumerate(JOINTS)}
    log = read(write(tmp_path, **columns))
    np.testing.assert_allclose(log.measured, values[1:], rtol=1e-9)
    np.testing.assert_allclose(log.desired[::2], values, rtol=1e-9)


def test_what_the_robot_was_asked_for_follows_from_its_torque(tmp_path) -> None:
    """tau = KP (mpos_d - mpos) - KD mvel, in counts of the gold arm, for a robot that stands."""
    columns: dict[str, object] = {}
    for j, word in enumerate(JOINTS[:3]):
        torque = float(position_loop.FORK2015.kp[j]) * 0.5
        columns[f"mpos_{word}"] = np.full(5, MOTORS[j])
        columns[f"mvel_{word}"] = np.zeros(5)
        columns[f"dac_{word}"] = -torque * float(transmission.COUNTS_PER_NM[j])
    log = read(write(tmp_path, **columns), period_ms=1.0)
    asked = np.array(
        [
            [float(m) for m in transmission.motor_from_joint(ARM, TOOL, Vec(q), None, SOFTWARE)]
            for q in log.desired
        ]
    )
    np.testing.assert_allclose(asked[:, :3], np.tile(np.array(MOTORS) + 0.5, (5, 1)), rtol=1e-9)
    assert np.isnan(log.measured[:, 3:]).all() and log.joints == [0, 1, 2]


DESIRED = "jpos_d", "jpos"
GOOD = {f"{name}_shoulder": [0.5, 0.6] for name in DESIRED}


@pytest.mark.parametrize(
    ("columns", "period", "message"),
    [
        (GOOD, None, "--period-ms"),
        (GOOD | {"time_s": [0.0, 0.0]}, None, "row 1"),
        (GOOD | {"jpos_d_elbow": [1.5, None]}, 1.0, "row 1, column jpos_d_elbow"),
        (GOOD | {"jpos_shoulder_deg": [30.0, 40.0]}, 1.0, "mean the same; keep one"),
        (GOOD | {"jpos_gold_shoulder": [0.5, 0.6]}, 1.0, "jpos_shoulder is there twice"),
        (GOOD | {"jpos_elbow": [90.0, 91.0]}, 1.0, "degrees, name .* jpos_elbow_deg"),
        (GOOD | {"jpos_insertion": [400.0] * 2}, 1.0, "0.23 to 0.56 m. If these are mm"),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_with_what_to_write(
    tmp_path, columns, period, message
) -> None:
    with pytest.raises(UserError, match=message):
        read(write(tmp_path, **columns), period)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("latin.csv", b"time_s,jpos_shoulder\n0,\xbb\n"),
        ("ragged.csv", b"a\n1\n1,2,3\n"),
        ("cut.parquet", b"PAR1"),
        ("other.parquet", b"a,b\n1,2\n"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, name, content) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UserError, match=f"{name}: cannot be read as a .(csv|parquet) table"):
        read(path)
