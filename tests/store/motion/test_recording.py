"""Recorded operator motions: kinds of files, units, what is replayed, and one clear error for
each kind of damage.
"""

import numpy as np
import pandas as pd
import pytest
from recorded_hands import ROWS, play, recording, refused, tip_mm
from scipy.spatial.transform import Rotation

from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.store.logs import trace_log
from ravenjax.store.motion import recording as recordings
from ravenjax.store.motion import source
from ravenjax.store.motion.options import ReplayOptions


@pytest.mark.parametrize("unit", ["um", "mm", "m"])
@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_units_and_kinds_agree(tmp_path, unit, kind):
    path = tmp_path / f"motion.{kind}"
    frame = recording(unit)
    frame.to_parquet(path) if kind == "parquet" else frame.to_csv(path, index=False)
    motion = play(path).motion
    assert motion.name == "motion"
    assert np.abs(tip_mm(motion)[-1] - tip_mm(motion)[0]).max() < 0.03  # once round
    assert np.ptp(tip_mm(motion), axis=0) == pytest.approx([6.0, 20.0, 0.0], abs=1e-3)
    assert motion.start_jpos[0][:3] == pytest.approx(
        [np.radians(30), np.radians(90), 0.4], abs=2e-3
    )


def test_tremor_stays_unless_a_low_pass_is_asked_for(parquet):
    """Half a millimetre at 9 Hz, which a low-pass of 5 Hz was once enough to remove without a
    word.
    """
    frame = recording()
    frame["gold_z_um"] += 500.0 * np.sin(2.0 * np.pi * 9.0 * frame["time_s"])
    path = parquet(frame)
    plain, smooth = play(path), play(path, cutoff_hz=5.0)
    assert np.ptp(tip_mm(plain.motion)[:, 2]) == pytest.approx(1.0, abs=1e-3)
    assert plain.summary.arms[0].removed is None
    assert np.ptp(tip_mm(smooth.motion)[800:-200, 2]) < 0.11
    rms_mm, largest_mm, _ = smooth.summary.arms[0].removed
    assert rms_mm == pytest.approx(0.5 / np.sqrt(2.0) * 0.91, abs=0.01)  # second order, both ways
    assert largest_mm == pytest.approx(0.458, abs=0.02)


def test_both_arms_pedal_and_grasp(parquet):
    frame = recording(arms=("gold", "green"))
    frame["surgeon_mode"] = (np.arange(ROWS) < 2000).astype(int)
    frame["green_grasp_deg"] = 90.0 - 30.0 * np.clip((np.arange(ROWS) - 1000) / 1000.0, 0.0, 1.0)
    one = play(parquet(frame), ("gold", "green"))
    motion = one.motion
    assert motion.surgeon_mode[1000] == 1.0 and motion.surgeon_mode[-1] == 0.0
    assert motion.grasp_mrad[-1, 1] == pytest.approx(
        np.radians(30.0) * 1e3, abs=1e-6
    )  # closing is positive
    assert np.abs(motion.grasp_mrad[:, 0]).max() < 1e-9
    assert np.abs(tip_mm(motion, "gold") - tip_mm(motion, "green") * [1, -1, 1]).max() < 1e-6
    assert [one.jaws for one in one.summary.arms] == ["home", "recorded"]


def test_orientation_is_followed(parquet):
    frame = recording()
    home = recordings.home_pose("gold").quat
    angle = np.radians(20.0) * np.sin(np.pi * np.arange(ROWS) / ROWS) ** 2
    turned = (
        Rotation.from_rotvec(angle[:, None] * [[0.0, 0.0, 1.0]]) * Rotation.from_quat(home)
    ).as_quat()
    turned[1::2] *= -1.0  # the same rotations
    for i, c in enumerate("xyzw"):
        frame[f"gold_q{c}"] = turned[:, i]
    one = play(parquet(frame))
    turns = 2.0 * np.arccos(np.clip(one.motion.quat[:, 0, 3], -1.0, 1.0))
    assert np.degrees(turns.max()) == pytest.approx(20.0, abs=0.01)
    axis = one.motion.quat[np.argmax(turns), 0, :3] @ np.array(ITP_AXES["gold"]).T
    assert axis / np.linalg.norm(axis) == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
    assert one.summary.arms[0].orientation == "recorded"


def test_a_trace_is_a_recording(tmp_path, parquet):
    """What `ravenjax trace` writes can be played again."""
    path, frame = tmp_path / "run.mcap", recording("m")
    place = frame[["gold_x_m", "gold_y_m", "gold_z_m"]].to_numpy()
    rotation = Rotation.from_quat(np.tile(recordings.home_pose("gold").quat, (ROWS, 1))).as_matrix()
    jpos = np.tile([0.5, 1.5, 0.4, 0.0, 0.0, 0.7, 0.8], (ROWS, 1))
    series = {"position_d": place, "rotation_d": rotation, "jpos": jpos, "jpos_d": jpos}
    series |= {"position": place + 0.001, "rotation": rotation}
    trace_log.write_trace(path, {f"gold/{name}": values for name, values in series.items()})
    one, same = play(path), play(parquet(frame))
    assert np.abs(tip_mm(one.motion) - tip_mm(same.motion)).max() < 1e-6
    assert one.summary.clock == "header stamps of /arm1/setpoint_cp"
    assert one.summary.read == ("/arm1/setpoint_cp", "/arm1/setpoint_js")
    assert one.summary.ignored == ("/arm1/measured_cp", "/arm1/measured_js", "/tf")
    track = source.read_track(path, ("gold",), ReplayOptions())
    assert track.arms["gold"].opening_mrad[0] == pytest.approx(1500.0)
    refused(path, "no topic /arm2/setpoint_cp or /arm2/measured_cp", arms=("gold", "green"))

    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    refused(path, "truncated")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("none.parquet", None, "no such file"),
        ("empty.csv", "", "is empty"),
        ("header.csv", "gold_x_um,gold_y_um,gold_z_um\n", "no rows"),
        ("motion.doc", "x", "unknown kind of file '.doc'"),
        ("one.csv", "gold_x_mm,gold_y_mm,gold_z_mm\n-78,-25,13\n", "contains 1 rows; expected a"),
    ],
)
def test_a_file_without_a_motion_is_refused(tmp_path, name, content, says):
    if content is not None:
        (tmp_path / name).write_text(content)
    refused(tmp_path / name, says)


@pytest.mark.parametrize(
    ("column", "row", "value", "says"),
    [
        ("gold_y_um", 17, None, "row 17, column gold_y_um: got nan"),
        ("surgeon_mode", 12, 3, "row 12, column surgeon_mode: got 3, expected 1 (pedal down) or 0"),
        ("gold_x_mm", 0, 1.0, "gold_x_mm and gold_x_um mean the same"),
        ("gold_qx", 30, 0.9, "row 30: quaternion"),
        ("gold_y_um", None, None, "no column gold_y_m or gold_y_mm or gold_y_um"),
    ],
)
def test_a_wrong_value_or_column_is_named(tmp_path, column, row, value, says):
    frame = recording().assign(surgeon_mode=1, **{f"gold_q{c}": 0.5 for c in "xyzw"}).astype(object)
    if row is None:
        frame = frame.drop(columns=column)
    else:
        frame.loc[row, column] = value
    frame.to_csv(tmp_path / "m.csv", index=False)
    refused(tmp_path / "m.csv", says)


@pytest.mark.parametrize(("is_in", "called"), [("m", "um"), ("um", "mm")])
def test_implausible_units_are_refused(parquet, is_in, called):
    frame = recording(is_in).rename(
        columns={f"gold_{a}_{is_in}": f"gold_{a}_{called}" for a in "xyz"}
    )
    refused(parquet(frame), "expected 5 to 500 mm", "gold_x_m, gold_x_mm or gold_x_um")


def test_a_recording_that_would_not_move_the_robot_is_refused(parquet):
    frame = recording()
    axes = ["gold_x_um", "gold_y_um", "gold_z_um"]
    frame[axes] = frame[axes].iloc[0].to_numpy()
    # the last digit of a sensor at rest
    frame["gold_x_um"] += np.arange(ROWS) % 2
    refused(parquet(frame), "s: the tip of gold stays within 1 um", 'motion = "still"')
    both = pd.concat([frame, recording(arms=("green",)).drop(columns="time_s")], axis=1)
    (notice,) = play(parquet(both), arms=("gold", "green")).summary.notices
    assert "no motion from 0.000 to 3.000 s: the tip of gold stays" in notice
    frame = recording().assign(surgeon_mode=(np.arange(ROWS) >= 2500).astype(int))
    refused(parquet(frame), "the pedal is never down from 0.000 to 1.000 s", window_s=(0, 1))


def test_public_recording(shared_data):
    """Its stamps are of arrival, forty rows at once; evenly spaced it is smooth enough to be
    followed.
    """
    path = shared_data("operator_positions.parquet")
    refused(
        path,
        "the time stamps come in bursts: according to column time_ns",
        "write operator.rate_hz = 999.956",
    )
    one = play(path, rate_hz=1000.0, window_s=(18.2, 47.9), cutoff_hz=5.0)
    assert one.motion.duration_s == pytest.approx(0.75 + 29.7, abs=0.01)
    speed = np.linalg.norm(np.diff(tip_mm(one.motion), axis=0), axis=1)  # mm per ms
    assert speed.max() < 0.2
    assert np.abs(np.diff(speed)).max() < 3e-3  # smooth: below 3 m/s2
    summary = one.summary
    assert summary.notes == (
        "column time_ns is not used, because operator.rate_hz = 1000 spaces rows evenly; it spans"
        " 60.942 s",
    )
    assert summary.ignored == ("time_ns", "green_x_um", "green_y_um", "green_z_um")
    assert summary.arms[0].inside == pytest.approx(0.927, abs=1e-3)
    assert summary.arms[0].removed[0] == pytest.approx(0.066, abs=0.002)
    refused(
        path, "shoulder of green", "parts can be reached", arms=("gold", "green"), rate_hz=1000.0
    )
