"""Logs of ROS: the same as a table of the same motion."""

from pathlib import Path

import bags
import numpy as np
import pandas as pd
import pytest

from ravenjax.analyses.calibration import joint_log, position_loop
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import JOINTS, ArmName
from ravenjax.store.logs.session.log import SessionWriter

ROWS = 40


def motion(phase: float) -> bags.Motion:
    """Joints every 4 ms, the measured behind the desired ones."""
    seconds = np.arange(ROWS) * 4e-3
    joints = np.array([0.5, 1.5, 0.4, 0.1, 0.1, 0.7, 0.8]) + 0.2 * np.sin(
        phase + 9.0 * seconds[:, None]
    )
    return bags.Motion(seconds, joints, joints - 0.003 * np.cos(phase + 9.0 * seconds[:, None]))


GOLD, GREEN = motion(0.0), motion(2.0)


def read(path: Path, arm: ArmName = "gold", period_ms: float | None = None) -> JointLog:
    return joint_log.read_joint_log(
        path, arm, "r_grasper", "raven2", position_loop.RAVEN2, period_ms
    )


def of_csv(folder: Path, one: bags.Motion) -> JointLog:
    columns = {"time_s": one.seconds}
    for j, word in enumerate(JOINTS):
        columns |= {f"jpos_d_{word}": one.desired[:, j], f"jpos_{word}": one.measured[:, j]}
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    return read(folder / "log.csv")


def assert_same(one: JointLog, other: JointLog, tolerance: float) -> None:
    assert one.cycles.tolist() == other.cycles.tolist()
    for name in ("start", "desired", "measured"):
        np.testing.assert_allclose(
            getattr(one, name), getattr(other, name), rtol=0.0, atol=tolerance
        )


@pytest.mark.parametrize(("arm", "one"), [("gold", GOLD), ("green", GREEN)])
@pytest.mark.parametrize("stamped", [True, False])
def test_states_of_raven2_are_a_table(tmp_path, arm, one, stamped) -> None:
    path = bags.state_bag(tmp_path / "log.bag", GOLD, GREEN, stamped=stamped)
    assert_same(read(path, arm), of_csv(tmp_path, one), 1e-6)  # they are float32, in degrees


@pytest.mark.parametrize(("arm", "one"), [("gold", GOLD), ("green", GREEN)])
@pytest.mark.parametrize("swapped", [True, False])
@pytest.mark.parametrize("name", ["log.bag", "log_of_ros2"])
def test_joint_states_of_crtk_are_a_table(tmp_path, arm, one, swapped, name) -> None:
    path = bags.crtk_bag(tmp_path / name, GOLD, GREEN, 1 if name.endswith(".bag") else 2, swapped)
    assert_same(read(path, arm), of_csv(tmp_path, one), 1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda names, position: (names[::-1], position[::-1].copy()), ""),
        (
            lambda names, position: (names[:3], position[:3]),
            "message 20 of /arm1/setpoint_js lacks",
        ),
        (
            lambda names, position: (names, position * np.nan),
            "message 20 of /arm1/setpoint_js lacks",
        ),
    ],
)
def test_each_message_is_read_by_its_own_names(tmp_path, change, says) -> None:
    path = bags.crtk_bag(tmp_path / "log.bag", GOLD, GREEN, change=change)
    if says:
        with pytest.raises(UserError, match=says):
            read(path)
    else:
        assert_same(read(path), of_csv(tmp_path, GOLD), 1e-12)


def test_a_session_of_ravenjax_can_be_read(tmp_path) -> None:
    """Its joint states come every 10 ms; a row lasts 1 ms."""
    names = [f"gold/{word}/{j}" for word in ("jpos", "jpos_d") for j in range(7)]
    seconds = np.arange(200) * 1e-3
    joints = np.array([0.5, 1.5, 0.4, 0.1, 0.1, 0.7, 0.8]) + 0.2 * np.sin(9.0 * seconds[:, None])
    rows = np.hstack([joints - 0.003, joints]).astype(np.float32)
    writer = SessionWriter(tmp_path / "session.mcap", names, {})
    writer.add(0, rows)
    writer.close()
    log = read(tmp_path / "session.mcap")
    assert log.cycles.tolist() == list(range(9, 190, 10))
    np.testing.assert_allclose(log.measured, rows[10::10, :7], atol=1e-6)
    np.testing.assert_allclose(log.desired[::10], rows[:191:10, 7:], atol=1e-6)


def test_the_longest_stretch_of_pedal_down_is_the_log(tmp_path) -> None:
    runlevel = np.full(ROWS, 3)
    runlevel[[0, 1, 8, 9, 10, 35]] = 2
    log = read(bags.state_bag(tmp_path / "log.bag", GOLD, GREEN, runlevel))
    assert len(log.measured) == 35 - 11 - 1
    np.testing.assert_allclose(log.start, GOLD.measured[11], atol=1e-6)
    with pytest.raises(UserError, match=r"has 0 rows in pedal-down \(runlevel 3\)"):
        read(bags.state_bag(tmp_path / "other.bag", GOLD, GREEN, np.full(ROWS, 1)))


@pytest.mark.parametrize("name", ["log.bag", "log.mcap", "log.db3"])
def test_what_is_no_bag_is_refused(tmp_path, name) -> None:
    (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n and then nothing")
    with pytest.raises(UserError, match="cannot be read as a bag or MCAP file"):
        read(tmp_path / name)
